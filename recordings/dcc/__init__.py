"""Digital calibration certificates (DCC): reading, checking signatures, and writing."""
