"""Replay: logs in, pipeline, command line."""
