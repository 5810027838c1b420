"""Machine files, and those that are shipped."""
