"""A stretch that a logger wrote twice is found; a coarse, smooth or still one is no copy."""

import numpy as np
import polars as pl
import pytest

from analysis.stages.signals.copied_rows import (
    drop_copied_rows,
    find_copied_rows_by_topic,
    find_copied_stretches,
    list_copied_row_notes,
    select_readings_with_noise,
)
from estimators.arrays import Floats, Ints

PERIOD_NS = 20_000_000
ROWS = 20_000


def stamps(rows: int = ROWS) -> Ints:
    return np.arange(rows) * PERIOD_NS


def pressure(seed: int = 1, rows: int = ROWS) -> Floats:
    """Readings to two digits, with noise of three tenths."""
    dice = np.random.default_rng(seed)
    return np.round(20.0 + 0.3 * dice.normal(size=rows), 2)


def copied(x: Floats, begin: int, again: int, rows: int) -> Floats:
    changed = x.copy()
    changed[again : again + rows] = x[begin : begin + rows]
    return changed


@pytest.mark.parametrize(
    ("begin", "again", "rows"), [(1000, 9001, 7500), (17, 18_403, 200), (400, 600, 200)]
)
def test_a_copy_is_found_to_its_rows(begin: int, again: int, rows: int) -> None:
    x = copied(pressure(), begin, again, rows)
    first, last, source = find_copied_stretches(stamps(), [x])[0]
    assert first - source == again - begin
    assert first == pytest.approx(again, abs=2)
    assert last == pytest.approx(again + rows - 1, abs=2)


def test_copied_rows_are_dropped_and_other_topics_kept() -> None:
    torque = pl.DataFrame({"log_time_ns": stamps(), "x": copied(pressure(), 1000, 9000, 500)})
    imu = pl.DataFrame({"log_time_ns": stamps(), "x": pressure(2)})
    raw = {"torque": torque, "imu": imu}
    copies = find_copied_rows_by_topic(raw)
    found, notes = drop_copied_rows(raw, copies), list_copied_row_notes(copies)
    assert found["torque"].equals(torque[np.delete(np.arange(ROWS), np.arange(9000, 9500))])
    assert found["imu"].equals(imu)
    assert notes == [
        "torque: 500 rows repeat earlier ones to the last digit and are left out, as rows that "
        "were not recorded"
    ]


def test_two_copies_of_one_stretch_are_two() -> None:
    x = copied(copied(pressure(), 1000, 6000, 1000), 1000, 12_000, 1000)
    assert len(find_copied_stretches(stamps(), [x])) == 2


@pytest.mark.parametrize("rows", [40, 90])
def test_a_copy_shorter_than_two_seconds_is_none(rows: int) -> None:
    assert not find_copied_stretches(stamps(), [copied(pressure(), 1000, 9000, rows)])


def test_a_copy_of_one_channel_alone_is_none_of_the_rows() -> None:
    x, y = copied(pressure(1), 1000, 9000, 500), pressure(2)
    assert not find_copied_stretches(stamps(), [x, y])


@pytest.mark.parametrize(
    "x",
    [
        np.full(ROWS, 3.0),
        # an encoder at standstill, between two counts
        np.random.default_rng(3).integers(0, 2, ROWS).astype(float),
        # one that counts, and a cycle that is driven again without noise
        np.tile(np.concatenate([np.arange(500.0), np.arange(500.0)[::-1]]), ROWS // 1000),
        np.sin(2.0 * np.pi * np.arange(ROWS) / 500.0).round(3),
        pressure(),
    ],
    ids=["constant", "two counts", "counter", "smooth", "noise"],
)
def test_what_repeats_by_itself_is_no_copy(x: Floats) -> None:
    columns = select_readings_with_noise(pl.DataFrame({"log_time_ns": stamps(), "x": x}))
    assert not find_copied_stretches(stamps(), columns)
