"""Notary of a recorder: the signed and chained list of its finished logs."""
