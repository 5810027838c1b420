"""Files that keep records in blocks, mostly compressed chunks: what ROS 1 bags and MCAP share."""

from replay.readers.blocks.block import Block
from replay.readers.blocks.damage import torn_end, until
from replay.readers.blocks.file import BlockFile
from replay.readers.blocks.loose import LooseRecords, resync
from replay.readers.blocks.slabs import Grammar
from replay.readers.blocks.store import BlockStore, Describe

__all__ = [
    "Block",
    "BlockFile",
    "BlockStore",
    "Describe",
    "Grammar",
    "LooseRecords",
    "resync",
    "torn_end",
    "until",
]
