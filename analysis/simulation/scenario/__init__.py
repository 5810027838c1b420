"""What is asked for: the sections of a scenario file."""
