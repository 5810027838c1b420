"""MCAP files."""

from replay.logs.mcap.mcap_file import McapFile
from replay.logs.mcap.mcap_metadata import metadata_records
from replay.logs.mcap.mcap_tail import McapTail

__all__ = ["McapFile", "McapTail", "metadata_records"]
