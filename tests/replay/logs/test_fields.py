"""Fields against message definitions."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay.logs.messages.message_fields import Field, FieldError, PathStep, resolve_message_field
from replay.logs.messages.message_types import (
    ListOf,
    RecordType,
    Scalar,
    iter_leaf_paths_of_message_type,
)

VECTOR = RecordType("geometry_msgs/msg/Vector3", tuple((axis, Scalar("float64")) for axis in "xyz"))
MESSAGE = RecordType(
    "test_msgs/msg/Everything",
    (
        ("stamp", Scalar("stamp")),
        ("angular_velocity", VECTOR),
        ("covariance", ListOf(Scalar("float64"), 9)),
        ("name", ListOf(Scalar("string"), None)),
        ("effort", ListOf(Scalar("float32"), None)),
        ("wrenches", ListOf(RecordType("test_msgs/msg/Wrench", (("force", VECTOR),)), None)),
        ("id", Scalar("uint64")),
    ),
)


def test_leaves_are_dotted_and_lists_show_as_lists() -> None:
    assert list(iter_leaf_paths_of_message_type(MESSAGE)) == [
        "stamp",
        *(f"angular_velocity.{axis}" for axis in "xyz"),
        "covariance[]",
        "name[]",
        "effort[]",
        *(f"wrenches[].force.{axis}" for axis in "xyz"),
        "id",
    ]


@pytest.mark.parametrize(
    ("name", "kind", "steps"),
    [
        ("stamp", "stamp", [("stamp", None)]),
        ("angular_velocity.z", "float64", [("angular_velocity", None), ("z", None)]),
        ("covariance[8]", "float64", [("covariance", 8)]),
        ("effort[boom.lift-1]", "float32", [("effort", "boom.lift-1")]),
        ("wrenches[2].force.x", "float64", [("wrenches", 2), ("force", None), ("x", None)]),
        ("wrenches[tip].force.x", "float64", [("wrenches", "tip"), ("force", None), ("x", None)]),
    ],
)
def test_a_field_resolves_to_its_kind_and_steps(
    name: str, kind: str, steps: list[tuple[str, int | str | None]]
) -> None:
    assert resolve_message_field(name, MESSAGE) == Field(
        name, kind, tuple(PathStep(*step) for step in steps)
    )


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("covariance[9]", "out of range; it has covariance[0] to covariance[8]"),
        ("angular_velocity.w", "did you mean 'angular_velocity.z'?"),
        ("angular_velocity.z.z", "no field 'angular_velocity.z.z'"),
        ("angular_velocity", "give one of angular_velocity.x, angular_velocity.y"),
        ("wrenches[0]", "'wrenches[0]' is a test_msgs/msg/Wrench"),
        ("id[0]", "'id' is not a list; ask for it without [0]"),
        ("angular_velocity.", "not a field name"),
    ],
)
def test_a_field_that_is_no_single_value_is_explained(name: str, answer: str) -> None:
    with pytest.raises(FieldError, match=re.escape(answer)):
        resolve_message_field(name, MESSAGE)


def test_an_element_by_name_needs_a_list_of_names() -> None:
    plain = RecordType("test_msgs/msg/Plain", (("effort", ListOf(Scalar("float64"), None)),))
    with pytest.raises(FieldError, match="has no list 'name'; select by index"):
        resolve_message_field("effort[left]", plain)


@given(st.text(max_size=30) | st.from_regex(r"[a-z.\[\]0-9]{0,12}", fullmatch=True))
def test_any_text_is_a_field_or_is_explained_in_one_line(name: str) -> None:
    known = {"stamp", "id", *(f"angular_velocity.{axis}" for axis in "xyz")}
    try:
        resolve_message_field(name, MESSAGE)
    except FieldError as error:
        fault = str(error)
    else:
        fault = ""
    assert len(fault.splitlines()) <= 1
    assert not (fault and name in known)
