"""Readers: one log, one table of formats. Outside of here a log is what these names are."""

from replay.logs.growing_logs import ACTIVE, GrowingLogFile, follow_log
from replay.logs.log import TABLE, Checked, Log, TableHints, TimeAxis
from replay.logs.log_formats import logs_among, logs_in, open_log

__all__ = [
    "ACTIVE",
    "TABLE",
    "Checked",
    "GrowingLogFile",
    "Log",
    "TableHints",
    "TimeAxis",
    "follow_log",
    "logs_among",
    "logs_in",
    "open_log",
]
