"""Recordings: what is kept of a run. Only this package imports Rerun and matplotlib, and late."""

from recordings.plot import plot_run
from recordings.reader import read_frame, read_provenance, read_recording, stages
from recordings.writer import check_recording, write_recording

__all__ = [
    "check_recording",
    "plot_run",
    "read_frame",
    "read_provenance",
    "read_recording",
    "stages",
    "write_recording",
]
