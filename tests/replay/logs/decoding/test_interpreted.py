"""Loops give the same bits interpreted and compiled: of random types, and of bytes of any kind."""

import struct
from collections.abc import Callable, Generator
from contextlib import contextmanager
from random import Random
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators import interpreted
from replay.logs.bag.bag_grammar import RECORD_FINDERS as BAG
from replay.logs.blocks import Block, RecordFinders
from replay.logs.blocks.block_groups import (
    MessageRowIndex,
    UnpackedBlockGroup,
    count_messages_of_chunks,
    select_messages_of_connections,
)
from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.decoding.decoder import DecodedBatch
from replay.logs.mcap.mcap_grammar import RECORD_FINDERS as MCAP
from tests.replay.logs.decoding.random_types import Sample, Types, batch_of, types
from tests.replay.logs.decoding.test_equality import RANDOM_TYPES, fields_of, same
from tests.twins import mark_heavy_after

T = TypeVar("T")
_TIMES = st.one_of(st.integers(0, 40), st.integers(0, 2**64 - 1))


@contextmanager
def _budget(seconds: float, turns: int) -> Generator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interpreted, "is_numba_imported", lambda: False)
        patch.setattr(interpreted._InterpreterBudget, "seconds", seconds)
        patch.setattr(interpreted, "MOST_TURNS", turns)
        yield


def both_ways(work: Callable[[], T]) -> tuple[T, T]:
    with _budget(0.0, 0):
        compiled = work()
    with _budget(float("inf"), 2**62):
        return compiled, work()


def assert_alike(ways: tuple[DecodedBatch, DecodedBatch]) -> None:
    compiled, by_python = ways
    assert same(compiled.frame, by_python.frame)
    assert compiled.undecodable == by_python.undecodable
    assert compiled.first_fault == by_python.first_fault


@pytest.mark.heavy
@pytest.mark.parametrize("encoding", mark_heavy_after(1, ["cdr_le", "cdr_be", "ros1", "xcdr2_le"]))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32))
def test_messages_of_a_random_type_whole_and_damaged(
    encoding: str, types: Types, seed: int
) -> None:
    sample = Sample(types, encoding, seed)
    plan = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields_of(sample, limit=12))
    rng = Random(seed)
    whole = sample.stored(encoding)
    assert_alike(both_ways(lambda: plan.decode(batch_of(whole))))
    damaged = []
    for stored in whole * 4:
        changed = bytearray(stored)
        for _ in range(rng.randrange(1, 4)):
            if changed:
                changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        end = rng.choice([len(changed), rng.randrange(len(changed) + 1)])
        damaged.append(bytes(changed[:end]))
    assert_alike(both_ways(lambda: plan.decode(batch_of(damaged))))


@RANDOM_TYPES
@given(types=types(), stored=st.lists(st.binary(max_size=200), min_size=1, max_size=20))
@pytest.mark.parametrize("encoding", ["cdr_le", "ros1"])
def test_any_bytes_as_messages(types: Types, stored: list[bytes], encoding: str) -> None:
    sample = Sample(types, encoding, 0)
    plan = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields_of(sample, limit=8))
    assert_alike(both_ways(lambda: plan.decode(batch_of(stored))))


def _mcap_record(channel: int, time: int, body: bytes) -> bytes:
    content = struct.pack("<HIQQ", channel, 0, time, time) + body
    return struct.pack("<BQ", 5, len(content)) + content


def _bag_record(connection: int, time: int, body: bytes) -> bytes:
    fields = (
        b"op=\x02",
        b"conn=" + struct.pack("<I", connection),
        b"time=" + struct.pack("<Q", time),
    )
    header = b"".join(struct.pack("<I", len(each)) + each for each in fields)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(body)) + body


@pytest.mark.parametrize(("finders", "record"), [(MCAP, _mcap_record), (BAG, _bag_record)])
@RANDOM_TYPES
@given(
    messages=st.lists(st.tuples(st.integers(0, 5), _TIMES, st.binary(max_size=30)), max_size=12),
    changes=st.lists(st.tuples(st.integers(0, 2**16), st.integers(0, 255)), max_size=5),
    noise=st.binary(max_size=40),
)
def test_records_in_chunks_whole_and_damaged(
    finders: RecordFinders,
    record: Callable[[int, int, bytes], bytes],
    messages: list[tuple[int, int, bytes]],
    changes: list[tuple[int, int]],
    noise: bytes,
) -> None:
    content = bytearray(b"".join(record(*message) for message in messages) + noise)
    for place, byte in changes:
        if content:
            content[place % len(content)] = byte
    data = np.array(content, np.uint8)
    wanted = np.array([0, 2, 3], np.int64)

    def work() -> list[object]:
        rows = MessageRowIndex(finders, data, 4)
        part = rows.add_rows_of_span(0, data.size)
        block = Block(0, 0, data.size, "", data.size)
        group = UnpackedBlockGroup(data, rows.indexed_rows, ((block, *part),), ())
        batches = select_messages_of_connections(data, group.rows, wanted, 3, 2**62)
        return [
            part,
            group.rows.tolist(),
            count_messages_of_chunks(group, wanted),
            [(b.connection_id, b.offsets.tolist(), b.log_times.tolist()) for b in batches],
        ]

    compiled, by_python = both_ways(work)
    assert compiled == by_python
