"""Sensor readings of a motion, and the part that the recorder keeps."""
