"""Code shared by bags and MCAP files, which store records in blocks, mostly compressed chunks."""

from replay.logs.blocks.block import Block
from replay.logs.blocks.block_file import BlockFile
from replay.logs.blocks.block_messages import BlockStore, Describe
from replay.logs.blocks.block_tail import GrowingBlockFile
from replay.logs.blocks.loose_records import UnchunkedRecords, find_records_after_damage
from replay.logs.blocks.lost_blocks import make_incomplete_end_clause, make_last_log_time_clause
from replay.logs.blocks.slabs import CountAndStop, RecordFinders

__all__ = [
    "Block",
    "BlockFile",
    "BlockStore",
    "CountAndStop",
    "Describe",
    "GrowingBlockFile",
    "RecordFinders",
    "UnchunkedRecords",
    "find_records_after_damage",
    "make_incomplete_end_clause",
    "make_last_log_time_clause",
]
