"""Explanations: what a run says of one moment, or of its worst manoeuvres."""

from analysis.explaining.determined import Determined
from analysis.explaining.explanation import Explanation, Finding, explain

__all__ = ["Determined", "Explanation", "Finding", "explain"]
