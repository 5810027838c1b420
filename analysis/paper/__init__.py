"""Numbers of the paper's tables, figures and claims, reproduced by simulation.

`printed_numbers` holds the numbers of the paper; `simulated_sources` lists the simulations and
replays that the items share. `table1`, `campaign_tables`, `excitation_figures`, `campaign_figures`
and `claims` compute the numbers; `recordings.paper` makes tables, pictures and sentences from them.
"""
