"""Readers: one small protocol, one table of suffixes, one file a format."""

from replay.readers.formats import format_name, open_log
from replay.readers.protocol import Log, TimeAxis

__all__ = ["Log", "TimeAxis", "format_name", "open_log"]
