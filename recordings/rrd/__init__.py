"""Rerun recordings: writer, reader, layout and viewer."""
