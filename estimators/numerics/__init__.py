"""Numerics that several estimators share: rolling sums, covariances, recursions."""
