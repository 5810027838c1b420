"""Conversion of logs: Parquet by topic, in bounded memory, taken up again where it was cut off.

`convert_log` goes through a log span by span, `unfinished_folder` keeps what is done, and
`PartWriter` writes one file.
"""
