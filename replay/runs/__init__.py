"""The commands `run` and `sweep`."""
