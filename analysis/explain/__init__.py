"""Explanations: what a run says of one moment, or of its worst manoeuvres."""

from analysis.explain.determined_parameters import DeterminedParameters
from analysis.explain.explanation import Explanation, Finding, explain

__all__ = ["DeterminedParameters", "Explanation", "Finding", "explain"]
