"""Logs of one shift that hold the same messages: each counts once, whatever was cut where."""

from pathlib import Path

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.errors import LogError
from replay.inputs.channel_inputs import merge_messages_of_logs
from replay.logs import Log

ROWS = 400
PERIOD_NS = 10**8
LATE_NS = 3_000_000


class Named:
    """What `merge_messages_of_logs` asks of a log: its name."""

    def __init__(self, number: int) -> None:
        self.path = Path(f"part_{number}.mcap")


def messages(*, stamped: bool = True) -> pl.DataFrame:
    row = pl.int_range(ROWS, eager=True)
    return pl.DataFrame(
        {
            "log_time_ns": 10**18 + row * PERIOD_NS,
            "header_stamp_ns": 10**18 + row * PERIOD_NS - LATE_NS if stamped else None,
            "value": row.cast(pl.Float64),
        },
        schema_overrides={"header_stamp_ns": pl.Int64},
    )


def of(*parts: pl.DataFrame) -> pl.DataFrame:
    logs: dict[Log, pl.DataFrame] = {Named(n): part for n, part in enumerate(parts)}  # pyright: ignore[reportAssignmentType]
    return merge_messages_of_logs("/topic", logs)


spans = st.lists(st.tuples(st.integers(0, ROWS), st.integers(1, ROWS)), min_size=1, max_size=6)


@pytest.mark.heavy
@given(spans, st.booleans(), st.randoms())
def test_parts_with_any_overlap_are_the_whole_of_what_they_cover(
    cut: list[tuple[int, int]], stamped: bool, random: "object"
) -> None:
    whole = messages(stamped=stamped)
    covered = pl.Series([any(a <= k < a + n for a, n in cut) for k in range(ROWS)])
    parts = [whole.slice(a, n) for a, n in cut]
    random.shuffle(parts)  # pyright: ignore[reportAttributeAccessIssue]
    assert of(*parts).equals(whole.filter(covered))


def test_a_second_recorder_that_stamps_arrivals_later_and_misses_some_adds_what_it_alone_has() -> (
    None
):
    whole = messages()
    row = pl.int_range(pl.len())
    first = whole.slice(0, 300).filter(row % 7 != 3)
    second = whole.slice(100).with_columns(pl.col("log_time_ns") + 1_700_000)
    found = of(first, second)
    assert found["header_stamp_ns"].n_unique() == found.height
    missed = whole.slice(0, 100).filter(row % 7 == 3).height
    assert found.height == ROWS - missed


def test_other_messages_at_one_time_are_refused_not_shuffled_in() -> None:
    whole = messages()
    other = whole.with_columns(pl.col("value") + 0.5, pl.col("header_stamp_ns") + 1)
    with pytest.raises(LogError, match=r"part_1\.mcap.* with different messages.*separately"):
        of(whole, other)


def test_messages_that_say_the_same_at_other_times_are_not_one() -> None:
    whole = messages().with_columns(value=pl.lit(1.0))
    assert of(whole.head(200), whole.slice(195)).height == ROWS
    assert of(whole.head(200), whole.tail(200)).height == ROWS
