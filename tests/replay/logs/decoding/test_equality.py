"""Columns against rosbags, message by message, over random types."""

import os
import struct
from collections.abc import Callable
from typing import Any

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.decoding.decoder_choice import PerMessageDecoder
from replay.logs.messages.message_fields import Field, resolve_message_field
from tests.replay.logs.decoding.random_types import Sample, Types, batch_of, every_field, types
from tests.twins import mark_heavy_after, mark_slow_after

#: In each encoding; `make decoding` sets 2500.
TYPES = int(os.environ.get("PAYSCOPE_RANDOM_TYPES", "24"))
#: An oracle is some milliseconds of generated code for each type.
RANDOM_TYPES = settings(
    max_examples=TYPES, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)


def same(left: pl.DataFrame, right: pl.DataFrame) -> bool:
    """Equal in every bit, NaN included."""
    if left.schema != right.schema:
        return False
    return all(_bits(left[name].to_list()) == _bits(right[name].to_list()) for name in left.columns)


def _bits(value: Any) -> Any:
    if isinstance(value, list):
        return [_bits(one) for one in value]
    return struct.pack("<d", value) if isinstance(value, float) else value


def fields_of(sample: Sample, limit: int = 60) -> list[Field]:
    names = sorted(set(every_field(sample.kind.record)))
    return [
        resolve_message_field(name, sample.kind.record)
        for name in names[:: len(names) // limit + 1]
    ]


def rosbags(sample: Sample, fields: list[Field], encoding: str) -> pl.DataFrame:
    """What rosbags makes of the messages."""
    decoded = PerMessageDecoder(sample.kind, fields).decode(batch_of(sample.stored(encoding)))
    assert decoded.undecodable == 0, decoded.first_fault
    return decoded.frame


def columnar(sample: Sample, fields: list[Field], encoding: str) -> pl.DataFrame:
    plan = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields)
    decoded = plan.decode(batch_of(sample.stored(encoding)))
    assert decoded.undecodable == 0, decoded.first_fault
    return decoded.frame


@pytest.mark.heavy
@pytest.mark.parametrize("encoding", mark_heavy_after(1, ["cdr_le", "cdr_be", "ros1"]))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32))
def test_all_fields_of_a_random_type_are_those_of_rosbags(
    encoding: str, types: Types, seed: int
) -> None:
    sample = Sample(types, encoding, seed)
    fields = fields_of(sample)
    assert same(columnar(sample, fields, encoding), rosbags(sample, fields, encoding))


@pytest.mark.heavy
@pytest.mark.parametrize("encoding", mark_slow_after(1, ["xcdr2_be", "xcdr2_le"]))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32))
def test_plain_xcdr2_holds_the_same_values_as_cdr(encoding: str, types: Types, seed: int) -> None:
    sample = Sample(types, encoding, seed)
    fields = fields_of(sample)
    assert same(columnar(sample, fields, encoding), rosbags(sample, fields, "cdr_le"))


@pytest.mark.heavy
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32), data=st.data())
def test_a_column_does_not_depend_on_what_else_is_asked_for(
    types: Types, seed: int, data: st.DataObject
) -> None:
    sample = Sample(types, "cdr_le", seed)
    fields = fields_of(sample)
    some = data.draw(st.lists(st.sampled_from(fields), max_size=4, unique=True)) if fields else []
    whole = columnar(sample, fields, "cdr_le")
    assert same(
        columnar(sample, some, "cdr_le"), whole.select(whole.columns[:2] + [f.name for f in some])
    )


@pytest.mark.heavy
@pytest.mark.parametrize("encoding", mark_slow_after(2, ["cdr_le", "ros1", "cdr_be", "xcdr2_le"]))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32), data=st.data())
def test_a_message_is_decoded_as_if_it_were_alone_whatever_came_before_it(
    encoding: str, types: Types, seed: int, data: st.DataObject
) -> None:
    sample = Sample(types, encoding, seed)
    fields = fields_of(sample)
    plan = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields)
    stored = [*sample.stored(encoding), *map(_flipped(data), sample.stored(encoding))]
    alone = [plan.decode(batch_of([message])) for message in stored]
    runs = data.draw(
        st.lists(st.tuples(st.sampled_from(range(len(stored))), st.integers(1, 20)), max_size=30)
    )
    order = [number for number, times in runs for _ in range(times)]
    together = plan.decode(batch_of([stored[number] for number in order]))
    assert together.undecodable == sum(alone[number].undecodable for number in order)
    expected = pl.concat([plan.decode(batch_of([])).frame, *(alone[k].frame for k in order)])
    assert same(together.frame.drop("log_time_ns"), expected.drop("log_time_ns"))


def _flipped(data: st.DataObject) -> Callable[[bytes], bytes]:
    """A message with a bit that is another, behind its encapsulation."""

    def flip(message: bytes) -> bytes:
        if len(message) <= 4:
            return message
        place = data.draw(st.integers(4, len(message) - 1))
        damaged = bytearray(message)
        damaged[place] ^= 1 << data.draw(st.integers(0, 7))
        return bytes(damaged)

    return flip


@pytest.mark.heavy
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32), data=st.data())
def test_one_topic_may_mix_encapsulations(types: Types, seed: int, data: st.DataObject) -> None:
    sample = Sample(types, "cdr_le", seed)
    fields = fields_of(sample)
    every = [sample.stored(e) for e in ("cdr_le", "cdr_be", "xcdr2_le", "xcdr2_be")]
    mixed = [data.draw(st.sampled_from(choices)) for choices in zip(*every, strict=True)]
    plan = DecodePlan(sample.kind.record, ros1=False, fields=fields)
    assert same(plan.decode(batch_of(mixed)).frame, rosbags(sample, fields, "cdr_le"))
