"""Replay of logs: readers of logs, the pipeline, and the command line.

    from replay import load_machine, open_log, run

Names are resolved when first used, so that the command line starts before NumPy does.
"""

from typing import TYPE_CHECKING

from estimators.late_names import make_lazy_import_getattr

if TYPE_CHECKING:
    from replay.logs import Log, TimeAxis, open_log
    from replay.machines.machine_file import load_machine
    from replay.pipeline import run

__all__ = ["Log", "TimeAxis", "load_machine", "open_log", "run"]

__getattr__ = make_lazy_import_getattr(
    "replay",
    {
        "Log": "replay.logs",
        "TimeAxis": "replay.logs",
        "load_machine": "replay.machines.machine_file",
        "open_log": "replay.logs",
        "run": "replay.pipeline",
    },
)
