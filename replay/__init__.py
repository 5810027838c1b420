"""Replay: logs in, pipeline, command line.

    from replay import load_machine, open_log, run

Names are resolved when first used, so that the command line starts before NumPy does.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from replay.logs import Log, TimeAxis, open_log
    from replay.machines.machine_file import load_machine
    from replay.pipeline import run

__all__ = ["Log", "TimeAxis", "load_machine", "open_log", "run"]

_HOMES = {"load_machine": "replay.machines.machine_file", "run": "replay.pipeline"}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in __all__:
        raise AttributeError(f"module 'replay' has no attribute '{name}'")
    return getattr(import_module(_HOMES.get(name, "replay.logs")), name)
