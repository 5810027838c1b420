"""A week of ledgers: days by the machine's clock, verdicts as they are now, each load once."""

import datetime as dt
from pathlib import Path

import pytest

from estimators.errors import ReviewError
from recordings.review.review_state import STATE, ReviewState
from recordings.review.shift_ledger import PARQUET, add_motion_columns, make_ledger_frame
from recordings.review.week_totals import (
    WeekPart,
    read_counted_loads_of_reviews,
    sum_week,
    sum_week_parts_by_group,
)
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found

FRAMES = found(drawn_shift([700.0] * 4, noise_kg=20.0))


def reviewed(folder: Path, begins: dt.datetime, *, zone: str, machine: str = "A") -> Path:
    """The ledger and the state of a review of four loads."""
    state = ReviewState(
        key="",
        recording_sha256="",
        inputs=(),
        resolved={},
        t0_unix_ns=int(begins.timestamp()) * 10**9,
        machine=machine,
        begins="",
        can_weigh=True,
        failed=(),
        losses=(),
        notes=(),
        gate_shares={},
        gaps_s=(),
        sampling=(),
        friction=(None, None),
        digs=4,
        timezone=zone,
    )
    folder.mkdir()
    add_motion_columns(make_ledger_frame(FRAMES, state.t0_unix_ns, {}), state).write_parquet(
        folder / PARQUET
    )
    (folder / STATE).write_text(state.model_dump_json(), encoding="utf-8")
    return folder


def test_a_shift_over_midnight_is_two_days_by_the_clock_of_the_machine(tmp_path: Path) -> None:
    ends_s = sorted(FRAMES.filter("counted")["end_t_ns"].to_numpy() / 1e9)
    midnight = dt.datetime(2025, 6, 1, 15, tzinfo=dt.UTC)  # of Tokyo
    begins = midnight - dt.timedelta(seconds=(ends_s[0] + ends_s[1]) / 2)
    days = sum_week_parts_by_group(
        read_counted_loads_of_reviews([reviewed(tmp_path / "a", begins, zone="Asia/Tokyo")]), "day"
    )
    assert [(each.name, each.loads) for each in days] == [
        ("2025-06-01", 1),
        ("2025-06-02", len(ends_s) - 1),
    ]


def test_a_verdict_counts_that_was_written_after_the_ledger(tmp_path: Path) -> None:
    folder = reviewed(tmp_path / "a", dt.datetime(2025, 6, 1, 8, tzinfo=dt.UTC), zone="UTC")
    before = sum_week(read_counted_loads_of_reviews([folder]))
    number = FRAMES.with_row_index().filter("counted")["index"][0]
    name = make_ledger_frame(
        FRAMES, int(dt.datetime(2025, 6, 1, 8, tzinfo=dt.UTC).timestamp()) * 10**9, {}
    )["id"][number]
    (folder / "verdicts.toml").write_text(
        f'[[cycle]]\nid = "{name}"\nreject = true\nauthor = "M"\ntime = 2025-06-02T08:00:00Z\n'
    )
    after = sum_week(read_counted_loads_of_reviews([folder]))
    assert after.loads == before.loads - 1
    assert after.payload_kg == pytest.approx(before.payload_kg - FRAMES["payload_kg"][int(number)])


def test_a_load_that_is_in_two_reviews_is_refused(tmp_path: Path) -> None:
    begins = dt.datetime(2025, 6, 1, 8, tzinfo=dt.UTC)
    twice = [reviewed(tmp_path / name, begins, zone="UTC") for name in ("a", "b")]
    with pytest.raises(ReviewError, match="that are also in"):
        read_counted_loads_of_reviews(twice)
    with pytest.raises(ReviewError, match="that are also in"):
        read_counted_loads_of_reviews(twice[:1] * 2)


def test_what_is_common_adds_up_within_a_machine_and_in_squares_between_them() -> None:
    parts = [WeekPart("d", name, "", 1, 100.0, 0.0, 3.0) for name in ("A", "A", "B")]
    assert sum_week(parts).payload_u_kg == pytest.approx((6.0**2 + 3.0**2) ** 0.5)


def test_a_folder_without_a_review_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ReviewError, match="holds no review"):
        read_counted_loads_of_reviews([tmp_path])
