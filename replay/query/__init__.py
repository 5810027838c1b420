"""SQL over logs, recordings, ledgers and the results of a fleet.

`named_tables` makes tables of what is named, `recording_frames` those of a recording, `moments`
makes of rows what `view --at` opens, and `run_query` answers.
"""
