"""Cycles of a loader: what was dug, hauled and dumped, and the totals of a shift."""
