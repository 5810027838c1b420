"""The line of a calibration: its model, fit, inversion and budget."""
