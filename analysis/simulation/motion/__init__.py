"""The machine's equations of motion, and its motion in time."""
