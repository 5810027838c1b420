"""Recordings of runs and their reports; only this package imports Rerun and matplotlib, and late.

Names are resolved when first used: the digest of a page that it keeps needs none of them.
"""

from typing import TYPE_CHECKING

from estimators.late_names import resolve_late

if TYPE_CHECKING:
    from recordings.plots.run_plots import plot_run
    from recordings.rrd.reader import read_frame, read_provenance, read_recording, stage_columns
    from recordings.rrd.writer import check_recording, write_recording

__all__ = [
    "check_recording",
    "plot_run",
    "read_frame",
    "read_provenance",
    "read_recording",
    "stage_columns",
    "write_recording",
]

__getattr__ = resolve_late(
    "recordings",
    {
        "check_recording": "recordings.rrd.writer",
        "plot_run": "recordings.plots.run_plots",
        "read_frame": "recordings.rrd.reader",
        "read_provenance": "recordings.rrd.reader",
        "read_recording": "recordings.rrd.reader",
        "stage_columns": "recordings.rrd.reader",
        "write_recording": "recordings.rrd.writer",
    },
)
