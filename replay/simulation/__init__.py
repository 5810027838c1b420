"""The command `simulate`: logs with known truth."""
