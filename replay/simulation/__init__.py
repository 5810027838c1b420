"""The command `simulate`: make logs with known truth."""
