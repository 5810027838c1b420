"""Recordings: what is kept of a run. Only this package imports Rerun and matplotlib, and late."""

from recordings.plots.run_plots import plot_run
from recordings.rrd.reader import read_frame, read_provenance, read_recording, stages
from recordings.rrd.writer import check_recording, write_recording

__all__ = [
    "check_recording",
    "plot_run",
    "read_frame",
    "read_provenance",
    "read_recording",
    "stages",
    "write_recording",
]
