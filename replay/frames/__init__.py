"""Logs as frames: topics as lazy frames of polars, and as streams of Arrow.

`shape` says what the columns of a topic are, `predicate` which time range a filter asks for,
`topic_source` gives batches of rows, and `scan` hands them to polars and to Arrow.
"""
