"""Noise of channels and grid columns, and its effect on estimates."""
