"""Parse records of a ROS 1 bag (wiki.ros.org/Bags/Format/2.0): a header of named fields, then data.

    length u32, fields (length u32, name=value) ..., length u32, data

The fields may be in any order; `op` is the kind of record.
"""

import struct
from typing import Final, NamedTuple

from replay.logs.storage import FileBytes, ReadBuffer

MAGIC: Final = b"#ROSBAG V"
VERSION: Final = b"2.0\n"

#: Opcodes of records (ROS bag format 2.0).
MESSAGE: Final = 2
BAG_HEADER: Final = 3
INDEX_DATA: Final = 4
CHUNK: Final = 5
CHUNK_INFO: Final = 6
CONNECTION: Final = 7

_U32: Final = struct.Struct("<I")
#: Most bytes of a header, which has a few numbers and the name of a topic.
LONGEST_HEADER: Final = 65_536


class BagRecord(NamedTuple):
    """Header of a record, and position of its data."""

    fields: dict[bytes, bytes]
    data_offset: int
    data_bytes: int

    @property
    def opcode(self) -> int:
        """Operation code; -1 if the header has none."""
        value = self.fields.get(b"op", b"")
        return value[0] if len(value) == 1 else -1

    def decode_unsigned_field(self, name: bytes) -> int:
        """Value of an unsigned integer field of at most 8 bytes.

        Raises:
            KeyError: the header lacks the field.
        """
        return int.from_bytes(self.fields[name][:8], "little")

    @property
    def end_offset(self) -> int:
        """Offset of the next record."""
        return self.data_offset + self.data_bytes


def parse_header_fields(header: bytes) -> dict[bytes, bytes] | None:
    """Parse the fields of a header; None if it is invalid."""
    fields: dict[bytes, bytes] = {}
    at = 0
    while at < len(header):
        if at + 4 > len(header):
            return None
        (size,) = _U32.unpack_from(header, at)
        name, is_field, value = header[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if at > len(header) or not is_field:
            return None
        fields[name] = value
    return fields


def read_bag_record(file: FileBytes | ReadBuffer, offset: int) -> BagRecord | None:
    """Read the header of the record at `offset`; None without one. Its data may be truncated."""
    head = file.read_bytes(offset, 256)
    if len(head) < 4:
        return None
    (size,) = _U32.unpack_from(head)
    if size > LONGEST_HEADER:
        return None
    if 8 + size > len(head):
        head = file.read_bytes(offset, 8 + size)
    if 8 + size > len(head):
        return None
    fields = parse_header_fields(head[4 : 4 + size])
    if not fields or b"op" not in fields:
        return None
    return BagRecord(fields, offset + 8 + size, _U32.unpack_from(head, 4 + size)[0])
