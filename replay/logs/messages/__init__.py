"""Shared by readers and decoders: message types, fields, raw batches, damaged data."""
