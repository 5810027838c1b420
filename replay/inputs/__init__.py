"""Logs put together: topics merged, times aligned, decoded once."""
