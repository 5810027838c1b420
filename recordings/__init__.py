"""Recordings and reports of runs; the only package that imports Rerun and matplotlib, when needed.

Names are resolved when first used, since the digest of the verifier's page needs none of them.
"""

from typing import TYPE_CHECKING

from estimators.late_names import make_lazy_import_getattr

if TYPE_CHECKING:
    from recordings.plots.run_plots import plot_run
    from recordings.rrd.reader import (
        list_columns_by_frame,
        read_frame,
        read_provenance,
        read_recording,
    )
    from recordings.rrd.writer import require_writable_recording, write_recording

__all__ = [
    "list_columns_by_frame",
    "plot_run",
    "read_frame",
    "read_provenance",
    "read_recording",
    "require_writable_recording",
    "write_recording",
]

__getattr__ = make_lazy_import_getattr(
    "recordings",
    {
        "require_writable_recording": "recordings.rrd.writer",
        "plot_run": "recordings.plots.run_plots",
        "read_frame": "recordings.rrd.reader",
        "read_provenance": "recordings.rrd.reader",
        "read_recording": "recordings.rrd.reader",
        "list_columns_by_frame": "recordings.rrd.reader",
        "write_recording": "recordings.rrd.writer",
    },
)
