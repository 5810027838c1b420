"""Comparison of two replays: a recording of both, and their differences in words."""
