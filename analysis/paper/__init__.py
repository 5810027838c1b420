"""The numbers of the paper's tables, figures and claims, found anew by simulation.

`paper` holds what the paper prints; `sources` names what is simulated and replayed, once for all
that is made of it. `table1`, `campaign_tables`, `excitation_figures`, `campaign_figures` and
`claims` make the numbers. `recordings.paper` makes tables, pictures and sentences of them.
"""
