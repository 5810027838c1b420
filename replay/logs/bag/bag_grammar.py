"""Compiled search for the records of a ROS 1 bag in bytes."""

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimators.interpreted import compiled, compiled_for_many_iterations
from replay.logs.bag.bag_records import CONNECTION, LONGEST_HEADER, MESSAGE
from replay.logs.blocks import CountAndStop, RecordFinders
from replay.logs.decoding.bytes_at import estimate_scan_iterations, load32, load64

#: Most bytes of a record's header in the search for records after damage.
_USUAL_HEADER: Final = 1024
#: Number of consecutive records by which bytes are recognised as records again.
_PROVEN: Final = 3
#: Names of fields with their equals sign, as little-endian numbers of 3 and of 5 bytes.
_OP, _CONN, _TIME = (int.from_bytes(name, "little") for name in (b"op=", b"conn=", b"time="))
#: Masks of the low bytes of a word.
_3_BYTES, _5_BYTES = 2**24 - 1, 2**40 - 1


#: Opcode, connection, time in ns, start of the data, and end of a record.
BagRecordParts: TypeAlias = tuple[int, int, int, int, int]


@compiled
def parse_bag_record(
    data: NDArray[np.uint8], offset: int, end: int, max_bytes: int
) -> BagRecordParts:
    """Parse the record at `offset`: op, connection, time, start of the data, and end of the record.

    The op is -1 if there is no record.
    """
    none = (-1, -1, -1, 0, 0)
    size = load32(data, offset)
    fields_end = offset + 4 + size
    if size > max_bytes or fields_end + 4 > end:
        return none
    op, connection, time = -1, -1, -1
    field = offset + 4
    while field + 4 <= fields_end:
        length = load32(data, field)
        value = field + 4
        field = value + length
        if field > fields_end:
            return none
        if length == 4 and load32(data, value) & _3_BYTES == _OP:
            op = load32(data, value) >> 24
        elif length == 9 and load64(data, value) & _5_BYTES == _CONN:
            connection = load32(data, value + 5)
        elif length == 13 and load64(data, value) & _5_BYTES == _TIME:
            time = load32(data, value + 5) * 1_000_000_000 + load32(data, value + 9)
    if field != fields_end or (op == MESSAGE and (connection < 0 or time < 0)):
        return none
    body = fields_end + 4
    return op, connection, time, body, body + load32(data, fields_end)


@compiled_for_many_iterations(estimate_scan_iterations)
def scan_bag_records(
    data: NDArray[np.uint8], start: int, end: int, out_rows: NDArray[np.int64], first_row: int
) -> CountAndStop:
    """Find the rows of messages and connections; see `block_groups.RecordFinders`.

    It stops at an incomplete record, and at a record that only occurs outside chunks.
    """
    found = 0
    at = start
    room = out_rows.shape[1]
    while at + 8 <= end:
        op, connection, time, body, stop = parse_bag_record(data, at, end, LONGEST_HEADER)
        if (op not in (MESSAGE, CONNECTION)) or stop > end:
            break
        if first_row < room:
            out_rows[0, first_row] = connection if op == MESSAGE else -1 - CONNECTION
            out_rows[1, first_row] = time
            out_rows[2, first_row] = body if op == MESSAGE else at
            out_rows[3, first_row] = stop - body if op == MESSAGE else stop - at
        first_row += 1
        found += 1
        at = stop
    return found, at


@compiled_for_many_iterations(estimate_scan_iterations)
def _find_next_bag_record(data: NDArray[np.uint8], start: int, end: int, limit: int) -> int:
    """Find the first offset from which several records follow each other; -1 if none."""
    for first in range(start, end - 7):
        at = first
        links = 0
        while links < _PROVEN and at + 8 <= end:
            op, _, _, _, stop = parse_bag_record(data, at, end, _USUAL_HEADER)
            if op < MESSAGE or op > CONNECTION or stop > limit:
                links = 0
                break
            at = stop
            links += 1
        # a sequence of records may end with the available bytes
        if links:
            return first
    return -1


RECORD_FINDERS: Final = RecordFinders(scan_bag_records, _find_next_bag_record)
