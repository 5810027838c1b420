"""Code shared by containers of every format: connections, file bytes, message rows, losses."""

from replay.logs.storage.container import (
    END_NS,
    LARGEST_BYTES,
    UNKNOWN_NS,
    BatchGroup,
    Connection,
    Container,
    Tail,
    make_empty_log_times,
)
from replay.logs.storage.file_bytes import FileBytes, ReadBuffer
from replay.logs.storage.loss_text import FileDamage, LossList
from replay.logs.storage.message_rows import (
    KEY,
    LENGTH,
    OFFSET,
    TIME,
    group_rows_by_connection,
    prefetch_items_in_thread,
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
    "FileBytes",
    "FileDamage",
    "LossList",
    "ReadBuffer",
    "Tail",
    "group_rows_by_connection",
    "make_empty_log_times",
    "prefetch_items_in_thread",
]
