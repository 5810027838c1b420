"""Digital calibration certificates (DCC): read with their signature, and written."""
