"""Readers: one log, one table of formats. Outside of here a log is what these names are."""

from replay.logs.growing_logs import ACTIVE, GrowingLogFile, follow_log
from replay.logs.log import TABLE, Log, LogCheck, TableHints, TimeAxis
from replay.logs.log_formats import logs_among, logs_in, open_log

__all__ = [
    "ACTIVE",
    "TABLE",
    "GrowingLogFile",
    "Log",
    "LogCheck",
    "TableHints",
    "TimeAxis",
    "follow_log",
    "logs_among",
    "logs_in",
    "open_log",
]
