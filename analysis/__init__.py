"""Analysis: frames in, frames out; no files, no screen."""

from analysis.machine import Machine
from analysis.run import InputFile, Loss, Provenance, Run
from analysis.settings import Settings

__all__ = ["InputFile", "Loss", "Machine", "Provenance", "Run", "Settings"]
