"""Estimators: arrays in, estimates out."""

from estimators import cache

# before any of them imports numba, which reads where to cache as it is imported
cache.ensure()
