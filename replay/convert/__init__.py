"""Conversion of logs: Parquet by topic, in bounded memory, resumed after an interruption.

`convert_log` goes through a log span by span, `unfinished_folder` keeps what is done, and
`PartWriter` writes one file.
"""
