"""A block: part of a file with complete records, mostly a compressed chunk."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.logs.storage import LARGEST_BYTES, FileBytes

#: Unpacked bytes beyond which a chunk's ratio of unpacked to stored bytes is limited: black images
#: are compressed a thousandfold, a decompression bomb thirty thousandfold.
_ANY_BYTES: Final = 64 * 2**20
_MOST_GROWTH: Final = 2000
#: Assumed most unpacked bytes of a truncated chunk, in multiples of its stored bytes.
_TORN_RATIO: Final = 64
_TORN_STEP: Final = 65_536
#: An empty skippable frame of zstd (RFC 8878, 3.1.2). The decompressor does not report that the
#: preceding frame is incomplete; with this one after it, it does.
_NOTHING: Final = bytes.fromhex("502a4d1800000000")
_NO_COUNTS: Final[dict[int, int]] = {}


class DamagedBlockError(Exception):
    """Raised if a block cannot be used; the text is the reason."""


@dataclass(frozen=True, slots=True)
class Block:
    """Position of stored records, and their description by an index or a scan."""

    #: offset at which its record begins, as losses state it
    record_offset: int
    offset: int
    stored_bytes: int
    #: `zstd`, `lz4`, `bz2`, or empty
    compression: str
    #: declared size, which the unpacked bytes must have; meaningless without compression
    unpacked_bytes: int
    #: CRC-32 of the unpacked bytes; 0 if none was written
    crc: int = 0
    #: whether the file ends inside it; the part that can be unpacked is used
    is_truncated: bool = False
    #: number of messages by connection
    counts: Mapping[int, int] = field(default_factory=lambda: _NO_COUNTS)
    #: first and last log time of its messages in ns
    first_ns: int = 0
    last_ns: int = -1

    @property
    def max_unpacked_bytes(self) -> int:
        """Upper bound of its unpacked size in bytes."""
        if not self.compression:
            return self.stored_bytes
        if not self.is_truncated:
            return self.unpacked_bytes
        most = _TORN_RATIO * self.stored_bytes + 2**20
        return min(self.unpacked_bytes or most, most, LARGEST_BYTES)


def unpack_block_into(block: Block, file: FileBytes, out_bytes: NDArray[np.uint8]) -> int:
    """Unpack a block into `out_bytes` (block.max_unpacked_bytes,), and return the number of bytes.

    Raises:
        DamagedBlockError: the block is implausibly large, cannot be unpacked, differs in size from
            what it declares, or its CRC is wrong.
    """
    if block.max_unpacked_bytes > LARGEST_BYTES:
        raise DamagedBlockError(
            f"it declares {block.max_unpacked_bytes:,} bytes, more than the limit of "
            f"{LARGEST_BYTES:,}"
        )
    if block.max_unpacked_bytes > max(_ANY_BYTES, _MOST_GROWTH * block.stored_bytes):
        raise DamagedBlockError(
            f"it declares {block.max_unpacked_bytes:,} bytes, more than {_MOST_GROWTH:,} times "
            f"its {block.stored_bytes:,} stored bytes"
        )
    if not block.compression:
        done = file.read_into(block.offset, out_bytes)
    elif block.compression not in ("zstd", "lz4", "bz2"):
        raise DamagedBlockError(f"its compression '{block.compression}' is not zstd, lz4 or bz2")
    else:
        done = _decompress_block_into(block, file, out_bytes)
    if block.is_truncated:
        return done
    if done != block.max_unpacked_bytes:
        raise DamagedBlockError(
            f"only {done:,} of the {block.unpacked_bytes:,} bytes it declares are there"
        )
    if block.crc and zlib.crc32(out_bytes.data) != block.crc:
        raise DamagedBlockError("its CRC is wrong")
    return done


def _read_zstd_block_and_append_empty_frame(block: Block, file: FileBytes) -> memoryview:
    """Read the stored bytes of a block, and append an empty frame unless it is truncated."""
    room = max(0, min(block.stored_bytes, file.size - block.offset))
    stored = np.empty(room + len(_NOTHING), np.uint8)
    done = file.read_into(block.offset, stored[:room])
    if block.is_truncated:
        return stored[:done].data
    stored[done : done + len(_NOTHING)] = np.frombuffer(_NOTHING, np.uint8)
    return stored[: done + len(_NOTHING)].data


def _decompress_block_into(block: Block, file: FileBytes, out_bytes: NDArray[np.uint8]) -> int:
    import pyarrow as pa  # slow to import, and not needed to describe a log by its index
    import zstandard

    view, done = out_bytes.data, 0
    # the decompressor reports a truncated stream, but not how much it has produced before
    step = _TORN_STEP if block.is_truncated else max(len(view), 1)
    if block.compression == "zstd":  # with its own library: Arrow copies through a buffer
        frames = _read_zstd_block_and_append_empty_frame(block, file)
        stream = zstandard.ZstdDecompressor().stream_reader(frames, read_across_frames=True)
    else:
        stored = pa.py_buffer(file.read_byte_array(block.offset, block.stored_bytes))
        stream = pa.CompressedInputStream(pa.BufferReader(stored), block.compression)
    try:
        while done < len(view):
            count = stream.readinto(view[done : done + step])
            if not count:
                return done
            done += count
        if not block.is_truncated and stream.read(1):
            raise DamagedBlockError(
                f"it unpacks to more than the {block.unpacked_bytes:,} bytes it declares"
            )
    except (OSError, MemoryError, pa.ArrowException, zstandard.ZstdError) as error:
        if not block.is_truncated:
            raise DamagedBlockError(" ".join(str(error).split()) or "not enough memory") from error
    return done
