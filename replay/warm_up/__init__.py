"""The command `warm-up`: compile all loops before the first run."""
