"""Compilation of all loops ahead of the first run."""
