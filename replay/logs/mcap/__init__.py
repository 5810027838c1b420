"""MCAP files."""

from replay.logs.mcap.mcap_file import McapFile, read_metadata_records
from replay.logs.mcap.mcap_tail import McapTail

__all__ = ["McapFile", "McapTail", "read_metadata_records"]
