"""Readers of logs: one class of logs, and one table of formats."""

from replay.logs.growing_logs import ACTIVE, GrowingLogFile, open_growing_log
from replay.logs.log import TABLE, Log, LogCheck, TableHints, TimeAxis
from replay.logs.log_formats import expand_log_folders, group_objects_by_log, open_log

__all__ = [
    "ACTIVE",
    "TABLE",
    "GrowingLogFile",
    "Log",
    "LogCheck",
    "TableHints",
    "TimeAxis",
    "expand_log_folders",
    "group_objects_by_log",
    "open_growing_log",
    "open_log",
]
