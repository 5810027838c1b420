"""Convert logs to Parquet by topic, in bounded memory, and resume after an interruption.

`convert_log` converts a log span by span, `unfinished_folder` records the completed spans, and
`PartWriter` writes a single file.
"""
