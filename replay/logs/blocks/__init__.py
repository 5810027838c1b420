"""Code shared by bags and MCAP: files that store records in blocks, mostly compressed chunks."""

from replay.logs.blocks.block import Block
from replay.logs.blocks.block_file import BlockFile
from replay.logs.blocks.block_messages import BlockStore, Describe
from replay.logs.blocks.block_tail import BlockTail
from replay.logs.blocks.loose_records import LooseRecords, resync
from replay.logs.blocks.lost_blocks import describe_end_of_reading, torn_end
from replay.logs.blocks.slabs import Grammar

__all__ = [
    "Block",
    "BlockFile",
    "BlockStore",
    "BlockTail",
    "Describe",
    "Grammar",
    "LooseRecords",
    "describe_end_of_reading",
    "resync",
    "torn_end",
]
