"""SQL over logs, recordings, ledgers and the results of a fleet.

`named_tables` opens the sources as tables, `recording_frames` the frames of a recording, and
`run_query` runs the statement and groups its rows into moments, which `view --at` opens.
"""
