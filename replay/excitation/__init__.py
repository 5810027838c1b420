"""The command `excite`."""
