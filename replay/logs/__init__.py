"""Readers: one log, one table of formats. Outside of here a log is what these names are."""

from replay.logs.log import TABLE, Checked, Log, TableHints, TimeAxis
from replay.logs.log_folder import logs_among, logs_in
from replay.logs.log_formats import open_log

__all__ = ["TABLE", "Checked", "Log", "TableHints", "TimeAxis", "logs_among", "logs_in", "open_log"]
