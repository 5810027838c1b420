"""Notary of a recorder's folder, which keeps a signed and chained list of its logs."""
