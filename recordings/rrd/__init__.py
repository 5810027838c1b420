"""Rerun recordings: write and read them, lay out their views, and open them in the viewer."""
