"""Code shared by bags and MCAP files, which store records in blocks, mostly compressed chunks."""

from replay.logs.blocks.block import Block
from replay.logs.blocks.block_damage import make_incomplete_end_clause, make_last_log_time_clause
from replay.logs.blocks.block_file import BlockFile
from replay.logs.blocks.block_groups import CountAndStop, RecordFinders
from replay.logs.blocks.block_messages import BlockStore, Describe
from replay.logs.blocks.growing_block_file import GrowingBlockFile
from replay.logs.blocks.unchunked_records import UnchunkedRecords, find_records_after_damage

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
