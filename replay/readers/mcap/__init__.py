"""MCAP files."""

from replay.readers.mcap.file import McapFile

__all__ = ["McapFile"]
