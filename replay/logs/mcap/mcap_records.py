"""The records of an MCAP file (mcap.dev/spec): opcode u8, length u64, content; little endian."""

import struct
from collections.abc import Mapping
from typing import Final

from replay.logs.blocks import Block
from replay.logs.storage import FileBytes

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_HEAD: Final = struct.Struct("<BQ")

#: Opcodes of records (MCAP specification).
FOOTER: Final = 0x02
SCHEMA: Final = 0x03
CHANNEL: Final = 0x04
MESSAGE: Final = 0x05
CHUNK: Final = 0x06
MESSAGE_INDEX: Final = 0x07
CHUNK_INDEX: Final = 0x08
STATISTICS: Final = 0x0B
METADATA: Final = 0x0C
DATA_END: Final = 0x0F

#: Bytes of these records behind their head.
FOOTER_BYTES: Final = 8 + 8 + 4
DATA_END_BYTES: Final = 4

#: the log times of the first and last message, unpacked size, CRC, length of the compression's name
_CHUNK: Final = struct.Struct("<QQQII")
_STORED: Final = struct.Struct("<Q")
#: Characters of a compression's name; the longest has four.
_LONGEST_NAME: Final = 32
#: The last log time, ns.
_INT64_MAX: Final = 2**63 - 1


def read_chunk_header_as_block(
    file: FileBytes, offset: int, message_counts: Mapping[int, int] | None = None
) -> Block | None:
    """Chunk whose record begins at `offset`, with messages by channel; None if there is none.

    A chunk that extends beyond the end of the file is torn.
    """
    head = file.read_bytes(offset, RECORD_HEAD.size + _CHUNK.size + _LONGEST_NAME + _STORED.size)
    try:
        opcode, length = RECORD_HEAD.unpack_from(head)
        first, last, unpacked, crc, size = _CHUNK.unpack_from(head, RECORD_HEAD.size)
        at = RECORD_HEAD.size + _CHUNK.size
        name = head[at : at + size].decode()
        (stored,) = _STORED.unpack_from(head, at + size)
    except (struct.error, UnicodeDecodeError):
        return None
    at += size + _STORED.size
    if opcode != CHUNK or at + stored != RECORD_HEAD.size + length:
        return None
    left = file.size - offset - at
    fits = last <= _INT64_MAX and first <= last
    return Block(
        offset,
        offset + at,
        min(stored, left),
        name,
        unpacked,
        crc,
        is_torn=stored > left,
        counts=message_counts or {},
        first_ns=first if fits else 0,
        last_ns=last if fits else -1,
    )
