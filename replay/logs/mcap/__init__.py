"""MCAP files."""

from replay.logs.mcap.mcap_file import McapFile, metadata_records
from replay.logs.mcap.mcap_tail import McapTail

__all__ = ["McapFile", "McapTail", "metadata_records"]
