"""Following a log while it is recorded."""
