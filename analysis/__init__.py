"""Analysis: frames in, frames out; no files, no screen."""

from analysis.model.machine import Machine
from analysis.model.run_record import InputFile, Loss, Provenance, Run
from analysis.model.settings import Settings

__all__ = ["InputFile", "Loss", "Machine", "Provenance", "Run", "Settings"]
