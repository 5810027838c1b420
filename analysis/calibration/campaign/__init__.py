"""A calibration campaign: its loads, runs and readings, and its fit."""
