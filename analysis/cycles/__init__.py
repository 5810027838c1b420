"""Cycles of a loader: what was dug, hauled and dumped, and what a shift adds up to."""
