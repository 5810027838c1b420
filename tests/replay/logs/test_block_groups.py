"""The records of a group of blocks: whose they are, and when."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from replay.logs.blocks.block_groups import MessageRowIndex, find_indices_of_values
from replay.logs.mcap.mcap_grammar import RECORD_FINDERS
from replay.logs.storage.message_rows import KEY, TIME

_INT64 = st.integers(-(2**63), 2**63 - 1)
_KEYS = st.sets(_INT64 | st.integers(0, 9), max_size=12)


@settings(deadline=None)  # the first compiles
@given(_KEYS, st.lists(_INT64 | st.integers(-3, 12), max_size=30))
def test_the_place_of_a_connection_is_found_however_they_are_numbered(
    keys: set[int], found: list[int]
) -> None:
    ascending = sorted(keys)
    of_both = [*found, *ascending]
    places = find_indices_of_values(np.array(of_both, np.int64), np.array(ascending, np.int64))
    assert places.tolist() == [ascending.index(key) if key in keys else -1 for key in of_both]


def _message(channel: int, time_ns: int) -> bytes:
    body = struct.pack("<HIQQ", channel, 0, time_ns, time_ns) + b"payload"
    return struct.pack("<BQ", 5, len(body)) + body


@pytest.mark.parametrize("expected", [0, 1, 4, 6, 100])
def test_rows_are_the_same_whatever_number_was_expected(expected: int) -> None:
    blocks = [
        [_message(1, 10), _message(2, 20)],
        [_message(1, 30)],
        [],
        [_message(3, 40), _message(1, 50), _message(2, 60)],
    ]
    data = np.frombuffer(b"".join(b"".join(block) for block in blocks), np.uint8)
    rows = MessageRowIndex(RECORD_FINDERS, data, expected)
    ends = np.cumsum([sum(map(len, block)) for block in blocks]).tolist()
    spans = [
        rows.add_rows_of_span(begin, end) for begin, end in zip([0, *ends], ends, strict=False)
    ]
    assert spans == [(0, 2, 0), (2, 3, 0), (3, 3, 0), (3, 6, 0)]
    assert rows.indexed_rows[KEY].tolist() == [1, 2, 1, 3, 1, 2]
    assert rows.indexed_rows[TIME].tolist() == [10, 20, 30, 40, 50, 60]
    # numba compiles anew for an array whose columns are apart
    assert rows.indexed_rows.flags.c_contiguous
