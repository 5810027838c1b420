"""The commands `info` and `init`: describe a log, and draft machine and campaign files."""
