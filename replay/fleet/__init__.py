"""Fleet: many recordings, replayed once on an engine and queried as one table."""
