"""Many recordings: replayed on an engine, kept once, queried as one table."""
