"""Readers: one small protocol, one table of suffixes, one file a format."""
