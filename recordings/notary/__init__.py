"""A recorder's notary: the signed, chained list of finished logs."""
