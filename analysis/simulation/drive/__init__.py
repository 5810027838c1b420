"""Drivers: logs and shifts driven on the integrated machine."""
