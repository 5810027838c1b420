"""MCAP files."""

from replay.logs.mcap.mcap_file import McapFile
from replay.logs.mcap.mcap_metadata import metadata_records

__all__ = ["McapFile", "metadata_records"]
