"""Simulated logs with their truth: campaigns, shifts, injected faults."""
