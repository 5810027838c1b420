"""Findings: named causes of a bad estimate. Their one table is `cause_table.CAUSES`."""

from analysis.findings.cause_table import CAUSES, UNKNOWN
from analysis.findings.find_causes import (
    add_masked_findings,
    cut_to_first_hour,
    drop_findings_explained_by_work_cycles,
    find_causes,
)
from analysis.findings.finding_inputs import FindingInputs

__all__ = [
    "CAUSES",
    "UNKNOWN",
    "FindingInputs",
    "add_masked_findings",
    "cut_to_first_hour",
    "drop_findings_explained_by_work_cycles",
    "find_causes",
]
