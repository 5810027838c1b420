"""Analysis: frames in, frames out; no files, no screen.

Names are resolved when first used: readers of logs need few of them, and settings take a while.
"""

from typing import TYPE_CHECKING

from estimators.late_names import make_lazy_import_getattr

if TYPE_CHECKING:
    from analysis.model.loss import Loss
    from analysis.model.machine import Machine
    from analysis.model.run_record import InputFile, Provenance, Run
    from analysis.model.settings import Settings

__all__ = ["InputFile", "Loss", "Machine", "Provenance", "Run", "Settings"]

__getattr__ = make_lazy_import_getattr(
    "analysis",
    {
        "InputFile": "analysis.model.run_record",
        "Loss": "analysis.model.loss",
        "Machine": "analysis.model.machine",
        "Provenance": "analysis.model.run_record",
        "Run": "analysis.model.run_record",
        "Settings": "analysis.model.settings",
    },
)
