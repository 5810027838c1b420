"""Trials solved exactly, each from standing to standing."""
