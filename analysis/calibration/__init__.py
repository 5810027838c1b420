"""Calibration on reference loads."""
