"""The Rerun recording: written, read back, laid out and viewed."""
