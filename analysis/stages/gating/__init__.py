"""Gating: which windows and manoeuvres are informative enough to estimate from."""
