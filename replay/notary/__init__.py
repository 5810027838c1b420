"""Notary of a recorder's folder: signed, chained lists of its logs."""
