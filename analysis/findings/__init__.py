"""Findings: named causes of a bad estimate. Their one table is `cause_table.CAUSES`."""

from analysis.findings.cause_table import CAUSES, UNKNOWN
from analysis.findings.find_causes import findings
from analysis.findings.finding_inputs import Case
from analysis.findings.masked_causes import beginning, behind

__all__ = ["CAUSES", "UNKNOWN", "Case", "beginning", "behind", "findings"]
