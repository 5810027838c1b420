"""Readers: one small protocol, one table of suffixes, one file a format."""

from replay.readers.formats import format_name, open_log
from replay.readers.protocol import Checked, Log, TimeAxis

__all__ = ["Checked", "Log", "TimeAxis", "format_name", "open_log"]
