"""The notary of a recorder's folder."""
