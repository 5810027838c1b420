"""Findings: named causes of a bad estimate. Their one table is `analysis.findings.table.CAUSES`."""

from analysis.findings.behind import beginning, behind
from analysis.findings.case import Case
from analysis.findings.findings import findings
from analysis.findings.table import CAUSES

__all__ = ["CAUSES", "Case", "beginning", "behind", "findings"]
