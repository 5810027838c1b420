"""What containers of every format share: connections, bytes of files, rows of messages, losses."""

from replay.readers.storage.container import LARGEST_BYTES, Connection, Container, no_times
from replay.readers.storage.damage import Damage, LossList
from replay.readers.storage.file_bytes import FileBytes, ReadBuffer
from replay.readers.storage.rows import KEY, LENGTH, OFFSET, TIME, group_by_key, prefetch

__all__ = [
    "KEY",
    "LARGEST_BYTES",
    "LENGTH",
    "OFFSET",
    "TIME",
    "Connection",
    "Container",
    "Damage",
    "FileBytes",
    "LossList",
    "ReadBuffer",
    "group_by_key",
    "no_times",
    "prefetch",
]
