"""The noise of channels, of the grid's columns, and what it does to estimates."""
