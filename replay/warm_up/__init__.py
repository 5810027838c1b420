"""Everything that is compiled, compiled ahead of the first run."""
