"""Explanations of a run: of one moment, or of its worst manoeuvres."""

from analysis.explain.determined_parameters import DeterminedParameters
from analysis.explain.explanation import Explanation, Finding, make_explanation

__all__ = ["DeterminedParameters", "Explanation", "Finding", "make_explanation"]
