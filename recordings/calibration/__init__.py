"""Evidence of a calibration: a folder that an auditor can verify without trusting its maker."""
