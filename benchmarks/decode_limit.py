"""What reading a log cannot go below: its bytes read, unpacked and summed, by one thread.

By the libraries that payscope uses, without looking for a message in what comes out.
"""

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
from mcap.stream_reader import StreamReader
from rosbags.rosbag1 import Reader as Reader1

Limit = Callable[[], object]
#: Offset, bytes as stored, compression, bytes unpacked.
Stored = tuple[int, int, str, int]
_STEP = 8 * 2**20


def limit_of(path: Path) -> Limit:
    """The least work that all of a file's messages ask for."""
    if path.suffix == ".mcap":
        chunks = _mcap_chunks(path)
        return lambda: [zlib.crc32(data) for data in _unpacked(path, chunks)]
    if path.suffix == ".bag":
        chunks = _bag_chunks(path)
        return lambda: [None for _ in _unpacked(path, chunks)]
    pieces = [(at, _STEP, "", _STEP) for at in range(0, path.stat().st_size, _STEP)]
    return lambda: [None for _ in _unpacked(path, pieces)]


def decompressor_of(path: Path) -> Limit:
    """Unpacking alone, of what lies in memory."""
    stored = [(path.read_bytes()[at : at + n], *rest) for at, n, *rest in _bag_chunks(path)]
    return lambda: [_unpack(*each) for each in stored]


def _unpacked(path: Path, chunks: list[Stored]) -> Any:
    with path.open("rb", buffering=0) as file:
        for offset, stored, compression, size in chunks:
            file.seek(offset)
            yield _unpack(file.read(stored), compression, size)


def _unpack(data: bytes, compression: str, size: int) -> Any:
    if not compression:
        return data
    if compression != "bz2":
        return pa.decompress(data, size, compression)
    return pa.CompressedInputStream(pa.BufferReader(data), "bz2").read(size)


def _mcap_chunks(path: Path) -> list[Stored]:
    with path.open("rb") as file:
        return [
            (
                file.tell() - len(chunk.data),
                len(chunk.data),
                chunk.compression,
                chunk.uncompressed_size,
            )
            for chunk in StreamReader(file, emit_chunks=True).records
            if type(chunk).__name__ == "Chunk"
        ]


def _bag_chunks(path: Path) -> list[Stored]:
    with Reader1(path) as reader, path.open("rb") as file:
        found: list[Stored] = []
        for info in reader.chunk_infos:
            file.seek(info.pos)
            head = file.read(256)
            name = head.partition(b"compression=")[2][:3].decode()
            size = int.from_bytes(head.partition(b"size=")[2][:4], "little")
            chunk = reader.chunks[info.pos]
            found.append((chunk.datapos, chunk.datasize, "" if name == "non" else name, size))
    return found
