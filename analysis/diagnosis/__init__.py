"""Diagnosis: what a log says of itself. Its one table is `analysis.diagnosis.checks.CHECKS`."""

from analysis.diagnosis.checks import CHECKS, verdict
from analysis.diagnosis.disagreement import disagreements
from analysis.diagnosis.evidence import Evidence
from analysis.diagnosis.left_out import without_named
from analysis.diagnosis.signals import signals
from analysis.diagnosis.worthless import judged_with_causes

__all__ = [
    "CHECKS",
    "Evidence",
    "disagreements",
    "judged_with_causes",
    "signals",
    "verdict",
    "without_named",
]
