"""Readers: one log, one table of formats. Outside of here a log is what these names are."""

from replay.readers.formats import OPENERS, open_log
from replay.readers.log import Checked, Log, TimeAxis

__all__ = ["OPENERS", "Checked", "Log", "TimeAxis", "open_log"]
