"""Picks and whole lists, by example: what is null, what is empty."""

import struct
from typing import Any

import polars as pl
import pytest

from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.message_types import ListOf, RecordType, Scalar
from tests.replay.logs.decoding.random_types import batch_of

POINT = RecordType("t/msg/Point", (("x", Scalar("int16")), ("y", Scalar("uint8"))))
PATH = RecordType("t/msg/Path", (("frame", Scalar("string")), ("points", ListOf(POINT, None))))
SURVEY = RecordType(
    "t/msg/Survey",
    (
        ("paths", ListOf(PATH, None)),
        ("fixed", ListOf(POINT, 2)),
        ("effort", ListOf(Scalar("float32"), 2)),
        ("name", ListOf(Scalar("string"), None)),
    ),
)


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def survey(paths: dict[str, list[tuple[int, int]]], names: list[str]) -> bytes:
    """In ROS 1; `fixed` is (7, 8), (9, 10), `effort` is 0.5, 1.5."""
    stored = [struct.pack("<I", len(paths))]
    for frame, points in paths.items():
        stored += [text(frame), struct.pack("<I", len(points))]
        stored += [struct.pack("<hB", *point) for point in points]
    stored.append(struct.pack("<hBhBff", 7, 8, 9, 10, 0.5, 1.5))
    stored += [struct.pack("<I", len(names)), *map(text, names)]
    return b"".join(stored)


STORED = [
    survey({"map": [(1, 2), (3, 4)], "odom": []}, ["left", "right"]),
    survey({}, []),
    survey({"base_link_of_the_loader": [(-5, 6)]}, ["right", "left", "left"]),
]


@pytest.mark.parametrize(
    ("field", "dtype", "values"),
    [
        ("paths[].frame", pl.List(pl.String), [["map", "odom"], [], ["base_link_of_the_loader"]]),
        ("paths[0].frame", pl.String, ["map", None, "base_link_of_the_loader"]),
        ("paths[1].frame", pl.String, ["odom", None, None]),
        ("paths[].points[].x", pl.List(pl.List(pl.Int16)), [[[1, 3], []], [], [[-5]]]),
        ("paths[].points[0].y", pl.List(pl.UInt8), [[2, None], [], [6]]),
        ("paths[0].points[].y", pl.List(pl.UInt8), [[2, 4], None, [6]]),
        ("paths[0].points[1].x", pl.Int64, [3, None, None]),
        ("fixed[].y", pl.List(pl.UInt8), [[8, 10]] * 3),
        ("fixed[1].x", pl.Int64, [9] * 3),
        ("fixed[left].x", pl.Int64, [7, None, 9]),
        (f"name[{'9' * 5000}]", pl.String, [None] * 3),
        ("effort[]", pl.List(pl.Float32), [[0.5, 1.5]] * 3),
        ("effort[1]", pl.Float64, [1.5] * 3),
        ("effort[left]", pl.Float64, [0.5, None, 1.5]),
        ("effort[right]", pl.Float64, [1.5, None, 0.5]),
        ("effort[boom]", pl.Float64, [None] * 3),
        ("name[]", pl.List(pl.String), [["left", "right"], [], ["right", "left", "left"]]),
        ("name[2]", pl.String, [None, None, "left"]),
    ],
)
def test_what_a_field_gives(field: str, dtype: pl.DataType, values: list[Any]) -> None:
    plan = DecodePlan(SURVEY, ros1=True, fields=[resolve_message_field(field, SURVEY)])
    column = plan.decode(batch_of(STORED)).frame[field]
    assert column.dtype == dtype
    assert column.to_list() == values


def test_lists_longer_than_was_guessed_are_whole() -> None:
    paths = {f"frame {k}": [(k, 0)] * (k % 3) for k in range(100)}
    fields = [
        resolve_message_field(name, SURVEY) for name in ("paths[].frame", "paths[].points[].x")
    ]
    decoded = DecodePlan(SURVEY, ros1=True, fields=fields).decode(batch_of([survey(paths, [])] * 3))
    assert decoded.frame["paths[].frame"].to_list() == [list(paths)] * 3
    assert (
        decoded.frame["paths[].points[].x"].to_list()
        == [[[x for x, _ in points] for points in paths.values()]] * 3
    )


def test_no_fields_give_the_stamps_and_no_messages_give_no_rows() -> None:
    plan = DecodePlan(SURVEY, ros1=True, fields=[])
    assert plan.decode(batch_of(STORED)).frame.columns == ["log_time_ns", "header_stamp_ns"]
    none = batch_of(STORED).select_messages(slice(0, 0))
    decoded = DecodePlan(
        SURVEY, ros1=True, fields=[resolve_message_field("paths[].points[].x", SURVEY)]
    ).decode(none)
    assert decoded.frame.schema["paths[].points[].x"] == pl.List(pl.List(pl.Int16))
    assert decoded.frame.is_empty()
