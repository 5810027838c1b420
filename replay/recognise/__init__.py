"""Recognise a log's columns by names, units, ranges and correlations."""
