"""Comparison of two replays."""
