"""Read topics of logs as lazy frames of polars, and as streams of Arrow.

`shape` determines the columns of a topic, and `predicate` the time range that a filter requests;
`topic_source` yields batches of rows, and `scan` passes them to polars and Arrow.
"""
