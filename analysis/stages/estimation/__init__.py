"""Estimation over the accepted windows, and the masses of a whole log."""
