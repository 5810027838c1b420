"""Analysis: frames in, frames out; no files, no screen.

Names are resolved when first used: readers of logs need few of them, and settings take a while.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.model.loss import Loss
    from analysis.model.machine import Machine
    from analysis.model.run_record import InputFile, Provenance, Run
    from analysis.model.settings import Settings

__all__ = ["InputFile", "Loss", "Machine", "Provenance", "Run", "Settings"]

_HOMES = {"Loss": "loss", "Machine": "machine", "Settings": "settings"}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in __all__:
        raise AttributeError(f"module 'analysis' has no attribute '{name}'")
    return getattr(import_module(f"analysis.model.{_HOMES.get(name, 'run_record')}"), name)
