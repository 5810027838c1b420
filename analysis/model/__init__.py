"""Shared data types: machine, settings, schema, methods, run, verdict, answer."""
