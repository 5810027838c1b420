"""Signatures, keys and keyrings, and the canonical bytes that are signed."""
