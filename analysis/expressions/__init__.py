"""Arithmetic of channels with units: parsed into a tree, checked by its units, never evaluated."""
