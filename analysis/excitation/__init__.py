"""Experiment design: the excitation with the most precise estimates of a simulated machine."""

from analysis.excitation.excitation_design import ExcitationDesign, WaveformScore, design_excitation

__all__ = ["ExcitationDesign", "WaveformScore", "design_excitation"]
