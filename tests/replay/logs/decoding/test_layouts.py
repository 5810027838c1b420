"""Messages of one size whose insides differ, which a remembered layout must not mistake."""

import struct

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.message_definitions import make_message_type_of_connection
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.message_types import iter_leaf_paths_of_message_type
from replay.logs.storage.container import Connection
from tests.replay.logs.decoding.random_types import batch_of

TYPE = make_message_type_of_connection(
    Connection(
        0, "/t", "t/msg/A", "ros1", "string a\nstring b\nuint8[] c\nstring[] name\nfloat64 e\n",
        "ros1msg",
    )
)  # fmt: skip
FIELDS = [
    resolve_message_field(leaf, TYPE.record)
    for leaf in iter_leaf_paths_of_message_type(TYPE.record)
]
PLAN = DecodePlan(TYPE.record, ros1=True, fields=FIELDS)
Parts = tuple[bytes, bytes, bytes, list[bytes], float]


@st.composite
def parts(draw: st.DrawFn) -> Parts:
    """Fields whose bytes, lengths included, always are as many."""
    text = draw(st.sampled_from([b"x" * 40, bytes(range(40))]))
    first = draw(st.sampled_from([0, 3, 8, 16, 24]))
    second = draw(st.sampled_from([24, 24, 32]))
    third = draw(st.sampled_from([32, 36, 40]))
    names = draw(st.sampled_from([[text[third:], b"1234"], [text[third:] + b"12345678"]]))
    value = draw(st.floats(width=32))
    return text[:first], text[first:second], text[second:third], names, value


def encoded(message: Parts) -> bytes:
    a, b, c, names, e = message
    counted = [struct.pack("<I", len(part)) + part for part in (a, b, c)]
    listed = [struct.pack("<I", len(name)) + name for name in names]
    return b"".join([*counted, struct.pack("<I", len(names)), *listed, struct.pack("<d", e)])


@settings(deadline=None)  # the first call compiles
@given(st.lists(st.tuples(parts(), st.integers(1, 3)), max_size=20))
def test_lengths_that_move_inside_a_message_of_one_size_move_its_fields(
    runs: list[tuple[Parts, int]],
) -> None:
    messages = [message for message, times in runs for _ in range(times)]
    stored = [encoded(message) for message in messages]
    assert len({len(each) for each in stored}) <= 1
    frame = PLAN.decode(batch_of(stored)).frame
    assert frame["a"].to_list() == [a.decode() for a, *_ in messages]
    assert frame["b"].to_list() == [b.decode() for _, b, *_ in messages]
    assert [bytes(c) for c in frame["c[]"].to_list()] == [c for _, _, c, *_ in messages]
    assert frame["name[]"].to_list() == [[n.decode() for n in names] for *_, names, _ in messages]
    assert np.array_equal(frame["e"].to_numpy(), [e for *_, e in messages], equal_nan=True)


def test_a_string_that_is_no_text_costs_its_message_where_the_one_before_was_text() -> None:
    message = (b"frame_of_the_bucket", b"", b"", [b"left"], 1.0)
    damaged = (b"frame_of_the_b\xffcket", b"", b"", [b"left"], 2.0)
    stored = [encoded(each) for each in (message, message, damaged, message)]
    decoded = PLAN.decode(batch_of(stored))
    assert decoded.frame["e"].to_list() == [1.0, 1.0, 1.0]
    assert (decoded.undecodable, decoded.first_fault) == (
        1,
        "a string in it is not UTF-8 (at its byte 23)",
    )


def test_a_layout_with_more_than_is_remembered_is_walked_each_time() -> None:
    many = (b"", b"", b"", [b"%d" % k for k in range(1000)], 1.0)
    frame = PLAN.decode(batch_of([encoded(many)] * 5)).frame
    assert frame["name[]"].to_list() == [[str(k) for k in range(1000)]] * 5
