"""Evidence of a calibration: a folder that an auditor can check without trusting who made it."""
