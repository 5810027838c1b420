"""Inputs of a replay: logs merged, aligned in time, and decoded once."""
