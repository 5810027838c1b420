"""Signatures, keys and the canonical bytes that are signed."""
