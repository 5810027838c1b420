"""Diagnosis: what a log says of itself. Its one table is `analysis.diagnosis.checks.CHECKS`."""

from analysis.diagnosis.checks import CHECKS, verdict

__all__ = ["CHECKS", "verdict"]
