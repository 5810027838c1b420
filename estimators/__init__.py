"""Estimators: arrays in, estimates out."""
