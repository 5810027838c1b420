"""The records of an MCAP file (mcap.dev/spec): opcode u8, length u64, content; little endian."""

import struct
from typing import Final

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_HEAD: Final = struct.Struct("<BQ")

FOOTER: Final = 0x02
SCHEMA: Final = 0x03
CHANNEL: Final = 0x04
MESSAGE: Final = 0x05
CHUNK: Final = 0x06
MESSAGE_INDEX: Final = 0x07
STATISTICS: Final = 0x0B
DATA_END: Final = 0x0F

FOOTER_BYTES: Final = 8 + 8 + 4
DATA_END_BYTES: Final = 4
