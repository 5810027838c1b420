"""What holds for every format of messages."""

from collections.abc import Callable, Sequence
from pathlib import Path

import polars as pl
import pytest

from estimators.errors import LogError
from replay import open_log
from tests.one_line import assert_one_line
from tests.replay.logs.written_logs import Joints

Write = Callable[[Sequence[Joints]], Path]

DRIVE = [
    Joints(1_000_000_000 + k * 10_000_000, {"left": float(k), "right": -float(k)}, stamp_ns=k)
    for k in range(5)
]


def test_topics_are_summarised_with_their_leaf_fields(write_log: Write) -> None:
    with open_log(write_log([*DRIVE, Joints(5, {}, topic="/other")])) as log:
        row = log.topics().row(by_predicate=pl.col("topic") == "/joints", named=True)
        assert log.topics()["topic"].to_list() == ["/joints", "/other"]
    assert row["type"] == "sensor_msgs/msg/JointState"
    assert (row["messages"], row["start_ns"], row["end_ns"]) == (5, 1_000_000_000, 1_040_000_000)
    assert row["rate_hz"] == pytest.approx(100)
    assert row["longest_gap_s"] == pytest.approx(0.01)
    assert row["problem"] is None
    assert {"header.stamp", "header.frame_id", "name[]", "effort[]"} <= set(row["fields"])


def test_a_joint_is_found_by_its_name_though_the_order_changes(write_log: Write) -> None:
    path = write_log(
        [
            Joints(1, {"left": 1.0, "right": 2.0}),
            Joints(2, {"right": 3.0, "left": 4.0}),
            Joints(3, {"right": 5.0}),
            Joints(4, {}),
        ]
    )
    frame = open_log(path).read("/joints", ["effort[left]", "effort[right]", "effort[1]"])
    assert frame["effort[left]"].to_list() == [1.0, 4.0, None, None]
    assert frame["effort[right]"].to_list() == [2.0, 3.0, 5.0, None]
    assert frame["effort[1]"].to_list() == [2.0, 4.0, None, None]


def test_stamps_strings_and_integers_become_columns_of_their_kind(write_log: Write) -> None:
    sample = Joints(7, {"left": 0.5}, stamp_ns=1_700_000_000_123_456_789)
    fields = ["header.stamp", "header.stamp", "header.frame_id", "name[0]"]
    frame = open_log(write_log([sample])).read("/joints", fields)
    assert frame.schema == pl.Schema(
        {
            "log_time_ns": pl.Int64,
            "header_stamp_ns": pl.Int64,
            "header.stamp": pl.Int64,
            "header.frame_id": pl.String,
            "name[0]": pl.String,
        }
    )
    stamp = 1_700_000_000_123_456_789
    assert frame.row(0) == (7, stamp, stamp, "base", "left")


def test_messages_that_were_stored_out_of_order_come_in_log_time_order(write_log: Write) -> None:
    times = [5, 3, 9, 3, 1]
    path = write_log([Joints(t, {"left": float(k)}) for k, t in enumerate(times)])
    frame = open_log(path).read("/joints", ["effort[left]"])
    assert frame["log_time_ns"].to_list() == [1, 3, 3, 5, 9]
    assert frame["effort[left]"].to_list() == [4.0, 1.0, 3.0, 0.0, 2.0]


def test_both_bounds_are_inclusive(write_log: Write) -> None:
    log = open_log(write_log(DRIVE))
    frame = log.read("/joints", [], start_ns=1_010_000_000, end_ns=1_030_000_000)
    assert frame["log_time_ns"].to_list() == [1_010_000_000, 1_020_000_000, 1_030_000_000]
    assert log.read("/joints", [], start_ns=2_000_000_000).is_empty()


def test_nan_and_infinite_samples_are_kept(write_log: Write) -> None:
    path = write_log([Joints(1, {"left": float("nan"), "right": float("-inf")})])
    frame = open_log(path).read("/joints", ["effort[left]", "effort[right]"])
    assert frame["effort[left]"].is_nan().all()
    assert frame["effort[right]"].to_list() == [float("-inf")]


def test_a_wrong_topic_is_answered_with_the_nearest(write_log: Write) -> None:
    log = open_log(write_log(DRIVE))
    with pytest.raises(LogError, match=r"no topic '/joint'; did you mean '/joints'\?"):
        log.read("/joint", [])


@pytest.mark.parametrize(
    ("field", "answer"),
    [
        ("efort[left]", r"no field 'efort\[left\]'; did you mean 'effort\[\]'\?"),
        ("header.stmp", r"did you mean 'header.stamp'\?"),
        ("effort", r"'effort' is a list; select an element by index, effort\[0\] or by name"),
        ("header", r"'header' is a std_msgs/msg/Header; give one of header"),
        ("header.stamp[0]", r"'header.stamp' is not a list"),
        ("", r"'' is not a field name"),
        ("effort[left", r"'effort\[left' is not a field name"),
    ],
)
def test_a_wrong_field_is_refused_before_any_message_is_decoded(
    write_log: Write, field: str, answer: str
) -> None:
    log = open_log(write_log(DRIVE))
    with pytest.raises(LogError, match=answer) as caught:
        log.read("/joints", [field])
    assert_one_line(caught.value)
    assert "shift" in str(caught.value)


def test_a_log_that_was_closed_says_so(write_log: Write) -> None:
    with open_log(write_log(DRIVE)) as log:
        pass
    with pytest.raises(LogError, match="closed; open it again"):
        log.read("/joints", [])


def test_more_messages_than_a_batch_holds_are_all_read(write_log: Write) -> None:
    many = [Joints(k, {"left": float(k)}) for k in range(20_000)]
    frame = open_log(write_log(many)).read("/joints", ["effort[left]"])
    assert frame["effort[left]"].to_list() == [float(k) for k in range(20_000)]
    assert frame["log_time_ns"].to_list() == list(range(20_000))


def test_a_clock_that_jumps_back_is_told_and_a_little_disorder_is_not(write_log: Write) -> None:
    second = 1_000_000_000
    times = [10, 11, 12, 13, 7, 8, 9]
    swapped = [second, 2 * second, 2 * second - 1_000_000, 3 * second]
    path = write_log(
        [
            *(Joints(t * second, {"left": 1.0}) for t in times),
            *(Joints(t, {"left": 1.0}, topic="/other") for t in swapped),
        ]
    )
    with open_log(path) as log:
        frame = log.read("/joints", ["effort[left]"])
        assert frame["log_time_ns"].to_list() == [t * second for t in sorted(times)]
        log.read("/other", ["effort[left]"])
        losses = [str(loss) for loss in log.losses()]
    assert len(losses) == 1
    assert "/joints" in losses[0]
    assert "log times jump back, by up to 6.000 s" in losses[0]
