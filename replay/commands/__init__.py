"""Commands, one per file; each imports what it needs when called."""
