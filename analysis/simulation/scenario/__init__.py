"""Sections of a scenario file."""
