"""Recordings: what is kept of a run."""
