"""Replay: logs in, pipeline, command line."""

from replay.readers import Log, TimeAxis, open_log

__all__ = ["Log", "TimeAxis", "open_log"]
