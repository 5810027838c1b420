"""Diagnosis: what a log says of itself. Its one table is `analysis.diagnosis.checks.CHECKS`."""

from analysis.diagnosis.check_inputs import Evidence
from analysis.diagnosis.checks import CHECKS, verdict
from analysis.diagnosis.excluded_stretches import without_named
from analysis.diagnosis.measured_channels import signals
from analysis.diagnosis.method_disagreement import disagreements
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
