"""Digital calibration certificates (DCC): read and write them, and check their signatures."""
