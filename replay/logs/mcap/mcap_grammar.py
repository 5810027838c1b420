"""Compiled search for the records of an MCAP file in bytes."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.interpreted import compiled, compiled_for_many_iterations
from replay.logs.blocks import CountAndStop, RecordFinders
from replay.logs.decoding.bytes_at import estimate_scan_iterations, load16, load32, load64
from replay.logs.mcap.mcap_records import CHANNEL, CHUNK, DATA_END, MESSAGE, RECORD_HEAD, SCHEMA

_HEAD: Final = RECORD_HEAD.size
#: bytes of channel u16, sequence u32, log time u64, publish time u64
_MESSAGE_HEAD: Final = 22
#: bytes of start, end and unpacked size u64, CRC u32, length of the compression's name u32, stored
#: size u64
_CHUNK_HEAD: Final = 40
_LAST_OPCODE: Final = DATA_END
#: Most characters of a compression's name; the longest known one has four.
_LONGEST_NAME: Final = 32
#: Sum of plausibilities of consecutive records by which bytes are recognised as records again.
_PROVEN: Final = 4


@compiled_for_many_iterations(estimate_scan_iterations)
def scan_mcap_records(
    data: NDArray[np.uint8], start: int, end: int, out_rows: NDArray[np.int64], first_row: int
) -> CountAndStop:
    """Find the rows of messages, schemas and channels; see `block_groups.RecordFinders`.

    It stops at an incomplete record, and at a record that only occurs outside chunks.
    """
    found = 0
    at = start
    room = out_rows.shape[1]
    while at + _HEAD <= end:
        opcode = np.int64(data[at])
        length = load64(data, at + 1)
        if length < 0 or length > end - at - _HEAD:
            break
        if opcode < SCHEMA or MESSAGE < opcode <= _LAST_OPCODE:
            break
        body = at + _HEAD
        if opcode == MESSAGE:
            if length < _MESSAGE_HEAD:
                break
            if first_row < room:
                out_rows[0, first_row] = load16(data, body)
                out_rows[1, first_row] = load64(data, body + 6)
                out_rows[2, first_row] = body + _MESSAGE_HEAD
                out_rows[3, first_row] = length - _MESSAGE_HEAD
            first_row += 1
            found += 1
        elif opcode in (SCHEMA, CHANNEL):
            if first_row < room:
                out_rows[0, first_row] = -1 - opcode
                out_rows[1, first_row] = 0
                out_rows[2, first_row] = body
                out_rows[3, first_row] = length
            first_row += 1
            found += 1
        at = body + length
    return found, at


@compiled
def _find_record_end_and_plausibility(
    data: NDArray[np.uint8], offset: int, end: int, file_end: int
) -> tuple[int, int]:
    """End of the record at `offset`, and its plausibility, 0 if it is not a record."""
    opcode = np.int64(data[offset])
    length = load64(data, offset + 1)
    if opcode < 1 or opcode > _LAST_OPCODE or length < 0 or length > file_end - offset - _HEAD:
        return 0, 0
    if opcode == MESSAGE and length < _MESSAGE_HEAD:
        return 0, 0
    proof = 1
    if opcode == CHUNK:
        if offset + _HEAD + _CHUNK_HEAD > end:
            return 0, 0
        name = load32(data, offset + _HEAD + 28)
        stored = offset + _HEAD + 32 + name
        if name > _LONGEST_NAME or stored + 8 > end:
            return 0, 0
        if load64(data, stored) != length - _CHUNK_HEAD - name:
            return 0, 0
        proof = _PROVEN  # 64 bits that agree
    return offset + _HEAD + length, proof


@compiled_for_many_iterations(estimate_scan_iterations)
def _find_next_mcap_record(data: NDArray[np.uint8], start: int, end: int, limit: int) -> int:
    """Find the first offset from which plausible records follow each other; -1 if none."""
    for first in range(start, end - _HEAD + 1):
        at = first
        proof = 0
        while proof < _PROVEN and at + _HEAD <= end:
            at, more = _find_record_end_and_plausibility(data, at, end, limit)
            if more == 0:
                proof = 0
                break
            proof += more
        # a sequence may end with the available bytes; a single record that does must be a message
        if proof > 1 or (proof == 1 and at == limit and data[first] == MESSAGE):
            return first
    return -1


RECORD_FINDERS: Final = RecordFinders(scan_mcap_records, _find_next_mcap_record)
