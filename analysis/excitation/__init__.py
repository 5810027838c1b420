"""Experiment design: which excitation makes the estimates of a simulated machine most precise."""

from analysis.excitation.excitation_design import Design, Score, design_excitation

__all__ = ["Design", "Score", "design_excitation"]
