"""Messages that are not what their definition says: torn, flipped, or made to deceive."""

import re
import struct
import tracemalloc
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.decoding.decoder_choice import PerMessageDecoder
from replay.logs.decoding.spans import NoPlanError
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.message_types import ListOf, RecordType, Scalar
from replay.logs.messages.raw_batch import RawBatch
from tests.replay.logs.decoding.random_types import Sample, Types, batch_of, types
from tests.replay.logs.decoding.test_equality import RANDOM_TYPES, fields_of, same
from tests.twins import mark_heavy_after, mark_slow_after

#: The bytes of the last are swapped; `test_equality.py` reads it whole.
ENCODINGS = mark_slow_after(2, ("cdr_le", "ros1", "cdr_be"))
JOINTS = RecordType(
    "t/msg/Joints",
    (
        ("label", Scalar("string")),
        ("name", ListOf(Scalar("string"), None)),
        ("effort", ListOf(Scalar("float64"), None)),
        ("poses", ListOf(RecordType("t/msg/Pose", (("frame", Scalar("string")),)), None)),
    ),
)


def torn(stored: list[bytes]) -> RawBatch:
    """Every beginning of every message, with its true rest right behind it in the data."""
    batch = batch_of(stored)
    starts = np.repeat(batch.offsets, batch.lengths)
    cuts = np.concatenate([np.arange(size) for size in batch.lengths])
    return RawBatch(0, batch.data, starts, cuts, np.arange(starts.size))


@pytest.mark.heavy
@pytest.mark.parametrize("encoding", mark_heavy_after(1, ENCODINGS))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32))
def test_a_message_torn_at_any_byte_is_whole_only_where_rosbags_says_so(
    encoding: str, types: Types, seed: int
) -> None:
    sample = Sample(types, encoding, seed, count=1)
    fields = fields_of(sample, limit=8)
    batch = torn(sample.stored(encoding))
    decoded = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields).decode(batch)
    expected = PerMessageDecoder(sample.kind, fields).decode(batch)
    assert same(decoded.frame, expected.frame)
    assert decoded.undecodable == expected.undecodable
    assert bool(decoded.first_fault) == bool(decoded.undecodable)


@pytest.mark.heavy
@pytest.mark.parametrize("encoding", mark_heavy_after(1, ENCODINGS))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32))
def test_a_message_with_flipped_bits_is_read_as_rosbags_reads_it(
    encoding: str, types: Types, seed: int
) -> None:
    sample = Sample(types, encoding, seed, count=2)
    rng = Random(seed)
    head = 0 if encoding == "ros1" else 4
    flipped = []
    for stored in sample.stored(encoding) * 20:
        damaged = bytearray(stored)
        for _ in range(rng.randrange(1, 4)):
            damaged[rng.randrange(head, len(damaged))] ^= 1 << rng.randrange(8)
        flipped.append(bytes(damaged))
    fields = fields_of(sample, limit=8)
    batch = batch_of([data for data in flipped if not _has_empty_string(sample, data)])
    decoded = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields).decode(batch)
    assert same(decoded.frame, PerMessageDecoder(sample.kind, fields).decode(batch).frame)


def _has_empty_string(sample: Sample, data: bytes) -> bool:
    """Whether CDR gives a string the length 0, which is legal and which rosbags refuses."""
    fault = PerMessageDecoder(sample.kind, []).decode(batch_of([data])).first_fault
    return "Invalid string length 0 " in fault


@RANDOM_TYPES
@given(types=types(), stored=st.lists(st.binary(max_size=200), min_size=1, max_size=20))
@pytest.mark.parametrize("ros1", [False, True])
def test_any_bytes_are_a_row_or_undecodable(types: Types, stored: list[bytes], ros1: bool) -> None:
    sample = Sample(types, "ros1" if ros1 else "cdr_le", 0)
    plan = DecodePlan(sample.kind.record, ros1=ros1, fields=fields_of(sample, limit=8))
    decoded = plan.decode(batch_of(stored))
    assert decoded.frame.height + decoded.undecodable == len(stored)


def _text(value: bytes, length: int | None = None) -> bytes:
    size = len(value) if length is None else length
    return struct.pack("<I", size) + value


@pytest.mark.parametrize("length", [2**32 - 1, 2**31, 2**29 + 1, 1000])
@pytest.mark.parametrize("place", range(5))
def test_a_length_beyond_the_end_of_its_message_is_refused_and_takes_no_memory(
    length: int, place: int
) -> None:
    lengths = [1, 1, 1, 1, 1]
    lengths[place] = length
    label, names, name, efforts, poses = lengths
    stored = b"".join(
        [
            _text(b"l", label),
            struct.pack("<I", names),
            _text(b"n", name),
            struct.pack("<Id", efforts, 1.5),
            struct.pack("<I", poses),
            _text(b"p"),
        ]
    )
    fields = [
        resolve_message_field(name, JOINTS)
        for name in ("label", "name[]", "effort[]", "effort[n]", "poses[].frame")
    ]
    plan = DecodePlan(JOINTS, ros1=True, fields=fields)
    batch = batch_of([stored] * 100)
    plan.decode(batch)  # compiles
    tracemalloc.start()
    decoded = plan.decode(batch)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert decoded.undecodable == 100
    assert "longer than the rest of the message" in decoded.first_fault
    assert peak < 1e6


@pytest.mark.parametrize("kind", ["float64", "string"])
def test_a_definition_of_large_messages_takes_no_memory_for_small_ones(kind: str) -> None:
    record = RecordType(
        "t/msg/Large", (("all", ListOf(Scalar(kind), 2**26)), ("id", Scalar("int8")))
    )
    fields = [resolve_message_field(name, record) for name in ("all[]", "id")]
    plan = DecodePlan(record, ros1=True, fields=fields)
    batch = batch_of([b"some"] * 1000)
    plan.decode(batch)  # compiles
    tracemalloc.start()
    decoded = plan.decode(batch)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert decoded.undecodable == 1000
    assert peak < 1e6


def test_messages_of_the_least_size_are_whole_beside_smaller_ones() -> None:
    record = RecordType("t/msg/Pair", (("label", Scalar("string")), ("id", Scalar("int8"))))
    plan = DecodePlan(
        record, ros1=True, fields=[resolve_message_field(n, record) for n in ("label", "id")]
    )
    stored = [_text(b"") + b"\7", b"", _text(b"a")[:4], _text(b"a") + b"\1", _text(b"") + b"\2"]
    decoded = plan.decode(batch_of(stored))
    assert decoded.frame.rows() == [(0, None, "", 7), (3, None, "a", 1), (4, None, "", 2)]
    assert decoded.undecodable == 2


@pytest.mark.parametrize("length", [0, None])
def test_no_plan_walks_lists_of_what_takes_no_bytes(length: int | None) -> None:
    nothing = RecordType("t/msg/Nothing", (("none", ListOf(Scalar("string"), 0)),))
    record = RecordType("t/msg/Many", (("many", ListOf(nothing, length)),))
    with pytest.raises(NoPlanError, match="array of length 0"):
        DecodePlan(record, ros1=True, fields=[])


def test_a_string_in_cdr_may_have_the_length_0() -> None:
    record = RecordType("t/msg/Label", (("label", Scalar("string")), ("id", Scalar("uint8"))))
    plan = DecodePlan(
        record, ros1=False, fields=[resolve_message_field(n, record) for n in ("label", "id")]
    )
    decoded = plan.decode(batch_of([b"\0\1\0\0" + struct.pack("<IB", 0, 7)]))
    assert decoded.frame.select("label", "id").rows() == [("", 7)]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (b"ab", "lacks its terminator"),
        (b"\xff\0", "not UTF-8"),
        (b"\xc0\x80\0", "not UTF-8"),
        (b"\xed\xa0\x80\0", "not UTF-8"),
        (b"\xf4\x90\x80\x80\0", "not UTF-8"),
        (b"\xe2\x86\0", "not UTF-8"),
    ],
)
def test_a_string_that_is_none_costs_the_message_also_when_nobody_asks_for_it(
    text: bytes, fault: str
) -> None:
    record = RecordType("t/msg/Label", (("label", Scalar("string")), ("id", Scalar("uint8"))))
    stored = b"\0\1\0\0" + _text(text) + b"\7"
    decoded = DecodePlan(record, ros1=False, fields=[resolve_message_field("id", record)]).decode(
        batch_of([stored])
    )
    assert decoded.undecodable == 1
    assert fault in decoded.first_fault


@given(st.binary(max_size=8))
def test_utf8_is_what_python_decodes(text: bytes) -> None:
    record = RecordType("t/msg/Label", (("label", Scalar("string")),))
    plan = DecodePlan(record, ros1=True, fields=[resolve_message_field("label", record)])
    decoded = plan.decode(batch_of([_text(text)]))
    try:
        expected = [text.decode()]
    except UnicodeDecodeError:
        expected = []
    assert decoded.frame["label"].to_list() == expected


@pytest.mark.parametrize(
    ("head", "fault"),
    [
        (b"\0\3\0\0", r"parameter list \(PL_CDR\) \(0x0003\)"),
        (b"\0\x09\0\0", "delimited XCDR2"),
        (b"\0\x0b\0\0", "parameter list XCDR2"),
        (b"\x12\x34\0\0", "0x1234"),
        (b"\0\1", "too short for its encapsulation"),
        (b"", "too short for its encapsulation"),
    ],
)
def test_an_encapsulation_that_cannot_be_read_is_named(head: bytes, fault: str) -> None:
    record = RecordType("t/msg/Id", (("id", Scalar("uint8")),))
    plan = DecodePlan(record, ros1=False, fields=[resolve_message_field("id", record)])
    good = b"\0\1\0\0\5"
    tail = b"\5" if len(head) == 4 else b""
    decoded = plan.decode(batch_of([good, head + tail, good]))
    assert decoded.frame.select("log_time_ns", "id").rows() == [(0, 5), (2, 5)]
    assert decoded.undecodable == 1
    assert re.search(fault, decoded.first_fault)


def test_a_batch_whose_messages_reach_out_of_its_data_is_a_programming_error() -> None:
    one = np.ones(1, np.int64)
    with pytest.raises(ValueError, match="lies outside the batch"):
        RawBatch(0, np.zeros(4, np.uint8), one, 4 * one, one)
    with pytest.raises(ValueError, match="lies outside the batch"):
        RawBatch(0, np.zeros(4, np.uint8), one, one * (2**63 - 1), one)
