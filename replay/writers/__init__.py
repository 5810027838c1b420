"""Writers of simulated logs: one file a format, one file for the messages inside."""
