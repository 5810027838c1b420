"""Experiment design: which excitation makes the estimates of a simulated machine most precise."""

from analysis.excitation.excitation_design import ExcitationDesign, WaveformScore, design_excitation

__all__ = ["ExcitationDesign", "WaveformScore", "design_excitation"]
