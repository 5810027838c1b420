"""Writers of simulated logs: a function a format, one file for the messages inside."""
