"""rosbag2's own zstd: whole files, or each message by itself. No size is believed."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import zstandard

from replay.logs.messages.raw_batch import BATCH_BYTES, RawBatch, join_messages
from replay.logs.storage import LARGEST_BYTES

#: What a compressed file or message may grow to, in multiples of its size.
_MOST_GROWTH: Final = 200
#: So large may a message be in any case: a black image is packed into next to nothing.
_ANY_MESSAGE: Final = 64 * 2**20
#: of a frame; zstd packs at most 128 KiB into 4 bytes
_FEW_BYTES: Final = 256
_STEP: Final = 2**20


def unpack_file(packed: Path, target: Path) -> str | None:
    """Unpack a file, and say why not all of it where it is damaged; what came before stays."""
    import pyarrow as pa  # slow to import, and most logs are not compressed so

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
    times: list[int] = []
    failed = size = 0
    for time, packed in zip(batch.log_times.tolist(), batch.messages(), strict=True):
        try:
            message = _unpack(unpacker, packed)
        except (zstandard.ZstdError, MemoryError):
            failed += 1
            continue
        messages.append(message)
        times.append(time)
        size += len(message)
        if size >= BATCH_BYTES:
            yield join_messages(batch.connection_id, times, messages), failed
            messages, times, failed, size = [], [], 0, 0
    yield join_messages(batch.connection_id, times, messages), failed


def _unpack(unpacker: zstandard.ZstdDecompressor, packed: bytes) -> bytes:
    room = min(_MOST_GROWTH * len(packed) + _ANY_MESSAGE, LARGEST_BYTES)
    declared = zstandard.frame_content_size(packed)
    if declared > room:
        raise zstandard.ZstdError("larger than is believed")
    if declared >= 0:
        return unpacker.decompress(packed, max_output_size=room)
    return _unpack_stepwise(unpacker, packed, room)


def _unpack_stepwise(unpacker: zstandard.ZstdDecompressor, packed: bytes, room: int) -> bytes:
    """Unpack a frame that does not tell its size, so much at once as a few bytes of it can hold."""
    stream = unpacker.decompressobj()
    parts: list[bytes] = []
    for at in range(0, len(packed), _FEW_BYTES):
        parts.append(stream.decompress(packed[at : at + _FEW_BYTES]))
        room -= len(parts[-1])
        if room < 0:
            raise zstandard.ZstdError("larger than is believed")
        if stream.eof:
            return b"".join(parts)
    raise zstandard.ZstdError("it breaks off")
