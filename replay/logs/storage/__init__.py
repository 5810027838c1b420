"""Code shared by containers of every format: connections, file bytes, message rows, losses."""

from replay.logs.storage.container import (
    END_NS,
    LARGEST_BYTES,
    UNKNOWN_NS,
    BatchGroup,
    Connection,
    Container,
    Tail,
    make_empty_times,
)
from replay.logs.storage.file_bytes import FileBytes, ReadBuffer
from replay.logs.storage.loss_text import Damage, LossList
from replay.logs.storage.message_rows import (
    KEY,
    LENGTH,
    OFFSET,
    TIME,
    group_rows_by_key,
    prefetch_items,
)

__all__ = [
    "END_NS",
    "KEY",
    "LARGEST_BYTES",
    "LENGTH",
    "OFFSET",
    "TIME",
    "UNKNOWN_NS",
    "BatchGroup",
    "Connection",
    "Container",
    "Damage",
    "FileBytes",
    "LossList",
    "ReadBuffer",
    "Tail",
    "group_rows_by_key",
    "make_empty_times",
    "prefetch_items",
]
