"""Recordings: what is kept of a run. Only this package imports Rerun and matplotlib, and late.

Names are resolved when first used: the digest of a page that it keeps needs none of them.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_HOMES = {
    "check_recording": "recordings.rrd.writer",
    "plot_run": "recordings.plots.run_plots",
    "write_recording": "recordings.rrd.writer",
}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in __all__:
        raise AttributeError(f"module 'recordings' has no attribute '{name}'")
    return getattr(import_module(_HOMES.get(name, "recordings.rrd.reader")), name)
