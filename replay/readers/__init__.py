"""Readers: one log, one table of formats. Outside of here a log is what these names are."""

from replay.readers.folder import logs_among, logs_in
from replay.readers.formats import open_log
from replay.readers.log import TABLE, Checked, Log, TableHints, TimeAxis

__all__ = ["TABLE", "Checked", "Log", "TableHints", "TimeAxis", "logs_among", "logs_in", "open_log"]
