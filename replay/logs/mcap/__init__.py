"""MCAP files."""

from replay.logs.mcap.mcap_file import McapFile

__all__ = ["McapFile"]
