"""rosbag2's own zstd: whole files, or each message by itself. No size is believed."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import zstandard

from replay.readers.container import RawBatch
from replay.readers.containers.block import LARGEST_BYTES
from replay.readers.containers.read_ahead import SLAB_BYTES

#: What a compressed file may grow to, in multiples of its size.
_MOST_GROWTH: Final = 200
_STEP: Final = 2**20


def unpack_file(packed: Path, target: Path) -> str | None:
    """Unpack a file, and say why not all of it where it is damaged; what came before stays."""
    # half of what is free is left to others
    free = shutil.disk_usage(target.parent).free // 2
    room = min(_MOST_GROWTH * packed.stat().st_size + _STEP, free)
    try:
        with pa.input_stream(packed, compression="zstd") as source, target.open("wb") as out:
            while step := source.read(_STEP):
                room -= len(step)
                if room < 0:
                    return f"it grows beyond {out.tell():,} bytes"
                out.write(step)
    except (OSError, pa.ArrowException) as error:
        return " ".join(str(error).split())
    return None


def unpack_messages(batch: RawBatch) -> Iterator[tuple[RawBatch, int]]:
    """A batch with its messages unpacked, in parts of bounded size; with each, how many failed."""
    unpacker = zstandard.ZstdDecompressor()
    messages: list[bytes] = []
    rows: list[int] = []
    failed = size = 0
    places = zip(batch.offset.tolist(), (batch.offset + batch.length).tolist(), strict=True)
    for row, (begin, end) in enumerate(places):
        try:
            message = _unpack(unpacker, batch.buffer[begin:end].tobytes())
        except (zstandard.ZstdError, MemoryError):
            failed += 1
            continue
        messages.append(message)
        rows.append(row)
        size += len(message)
        if size >= SLAB_BYTES:
            yield _joined(batch, rows, messages), failed
            messages, rows, failed, size = [], [], 0, 0
    yield _joined(batch, rows, messages), failed


def _unpack(unpacker: zstandard.ZstdDecompressor, packed: bytes) -> bytes:
    if zstandard.frame_content_size(packed) > LARGEST_BYTES:
        raise zstandard.ZstdError("larger than is believed")
    # where the frame does not tell its size, more than this is an error
    return unpacker.decompress(packed, max_output_size=LARGEST_BYTES)


def _joined(batch: RawBatch, rows: list[int], messages: list[bytes]) -> RawBatch:
    length = np.fromiter(map(len, messages), np.int64, len(messages))
    buffer = np.frombuffer(b"".join(messages), np.uint8)
    times = batch.log_time_ns[rows]
    return RawBatch(batch.connection_id, times, buffer, np.cumsum(length) - length, length)
