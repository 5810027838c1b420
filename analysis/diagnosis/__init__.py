"""Diagnosis: whether a log can weigh. The table of checks is `analysis.diagnosis.checks.CHECKS`."""

from analysis.diagnosis.check_inputs import CheckInputs
from analysis.diagnosis.checks import (
    CHECKS,
    add_check_of_invalidating_findings,
    judge_log_by_checks,
)
from analysis.diagnosis.excluded_stretches import refit_without_failing_stretches
from analysis.diagnosis.fit_checks import compare_methods_with_joint_fit
from analysis.diagnosis.measured_channels import collect_raw_signals

__all__ = [
    "CHECKS",
    "CheckInputs",
    "add_check_of_invalidating_findings",
    "collect_raw_signals",
    "compare_methods_with_joint_fit",
    "judge_log_by_checks",
    "refit_without_failing_stretches",
]
