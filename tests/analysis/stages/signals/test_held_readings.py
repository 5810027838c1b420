"""Readings held over rows of a table count once; coarse, standing and noisy ones as they are."""

import numpy as np
import pytest

from analysis.stages.signals.held_readings import (
    HeldReadings,
    drop_rows_with_held_readings,
    find_held_channels,
    list_held_reading_notes,
)

RATE_HZ = 50.0
ROWS = 6000
DICE = np.random.default_rng(8)


def drive() -> np.ndarray:
    """Speed (n,) of starts and stops in m/s at 50 Hz, 0 at stands."""
    t = np.arange(ROWS) / RATE_HZ
    return np.clip(6.0 * np.sin(2.0 * np.pi * t / 40.0) * np.sin(2.0 * np.pi * t / 13.0), 0.0, 4.0)


def noise(std: float) -> np.ndarray:
    return DICE.normal(0.0, std, ROWS)


def hold(x: np.ndarray, rows: float) -> np.ndarray:
    """Readings of every so many rows, each repeated until the next."""
    return x[np.floor(np.floor(np.arange(x.size) / rows) * rows).astype(int)]


def hold_with_jitter(x: np.ndarray, rows: float, lost: float = 0.0) -> np.ndarray:
    """Readings at distances that scatter by a quarter, of which some never come."""
    steps = np.maximum(DICE.normal(rows, rows / 4.0, x.size).round(), 1.0).astype(int)
    taken = np.append(0, np.cumsum(steps))
    taken = taken[(taken < x.size) & ((DICE.random(taken.size) >= lost) | (taken == 0))]
    return np.repeat(x[taken], np.diff(np.append(taken, x.size)))


def rows_held(x: np.ndarray) -> float | None:
    found = HeldReadings.from_readings(x, RATE_HZ)
    return None if found is None else found.rows


@pytest.mark.parametrize("rows", [2, 5, 10, 25, 5.0 / 3.0, 2.5])
@pytest.mark.parametrize("std", [0.0, 0.01])
def test_a_held_speed_is_found_however_long_it_is_held(rows: float, std: float) -> None:
    assert rows_held(hold(drive() + noise(std), rows)) == pytest.approx(rows, rel=0.05)


@pytest.mark.parametrize("rows", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("lost", [0.0, 0.05])
def test_so_is_one_that_comes_unevenly_and_loses_messages(rows: float, lost: float) -> None:
    found = rows_held(hold_with_jitter(drive() + noise(0.01), rows, lost))
    assert found == pytest.approx(rows, rel=0.1)


@pytest.mark.parametrize("step", [0.001, 0.01, 0.03])
def test_a_held_speed_that_is_coarse_as_well_is_found(step: float) -> None:
    assert rows_held(np.round(hold(drive(), 5) / step) * step) == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("step", [0.001, 0.01, 0.03, 0.1, 0.278])
@pytest.mark.parametrize("std", [0.0, 0.003, 0.03, 0.3])
def test_a_coarse_speed_repeats_itself_and_is_not_held(step: float, std: float) -> None:
    assert rows_held(np.round((drive() + noise(std)) / step) * step) is None


@pytest.mark.parametrize("x", [drive(), drive() + noise(0.01), np.zeros(ROWS), noise(1.0).clip(0)])
def test_stands_and_limits_are_not_held(x: np.ndarray) -> None:
    assert rows_held(x) is None


def test_a_speed_of_pulses_that_come_at_any_time_is_not_held() -> None:
    """Each pulse gives a new reading: below 3 m/s rarer than a row, above it in every one."""
    way = np.floor(np.cumsum(drive()) / RATE_HZ / 0.06)
    pulses = np.flatnonzero(np.diff(way, prepend=0.0))
    exact = drive() + noise(0.001)
    assert rows_held(np.repeat(exact[pulses], np.diff(np.append(pulses, ROWS)))) is None


def test_a_force_that_a_program_sets_for_seconds_is_not_held() -> None:
    assert rows_held(np.repeat(DICE.normal(size=ROWS // 75), 75)) is None


def test_a_table_at_a_rate_like_its_sensors_repeats_some_rows_and_is_not_held() -> None:
    assert rows_held(hold(drive() + noise(0.01), 1.25)) is None


def test_each_reading_counts_once_when_it_was_taken() -> None:
    x = drive() + noise(0.01)
    held = hold(x, 5)
    found = HeldReadings.from_readings(held, RATE_HZ)
    assert found is not None
    assert found.find_rows_of_new_readings(held).tolist() == list(range(0, ROWS, 5))


def test_a_reading_that_is_lost_is_not_made_up_for_by_the_one_before() -> None:
    x = hold(drive() + noise(0.01), 5)
    x[1000:1005] = x[999]
    taken = HeldReadings(5.0).find_rows_of_new_readings(x)
    assert taken.tolist() == [row for row in range(0, ROWS, 5) if row != 1000]


def test_a_stand_is_no_gap() -> None:
    x = hold(drive(), 5)
    taken = HeldReadings(5.0).find_rows_of_new_readings(x)
    assert (x == 0.0).mean() > 0.2
    assert np.diff(taken).max() <= 10


def test_no_row_depends_on_what_comes_later() -> None:
    x = hold_with_jitter(drive(), 5.0)
    held = HeldReadings(5.0)
    whole = held.find_rows_of_new_readings(x)
    for rows in (100, 1234, 5000):
        assert held.find_rows_of_new_readings(x[:rows]).tolist() == whole[whole < rows].tolist()


def test_channels_held_for_different_times_are_taken_each_at_its_own_rate() -> None:
    t = (np.arange(ROWS) * 1e9 / RATE_HZ).astype(np.int64)
    read = {
        "force_x_N": (t, noise(30.0)),
        "speed_left_m_s": (t, hold(drive() + noise(0.01), 5)),
        "speed_right_m_s": (t, hold(drive() + noise(0.01), 2)),
        "boom_rad": (t, hold(drive(), 5)),
    }
    held = find_held_channels(read)
    found = drop_rows_with_held_readings(read, held)
    sizes = {name: x.size for name, (_, x) in found.items()}
    assert sizes == {
        "force_x_N": ROWS,
        "speed_left_m_s": ROWS // 5,
        "speed_right_m_s": ROWS // 2,
        "boom_rad": ROWS,  # no estimate needs it
    }
    assert found["force_x_N"] is read["force_x_N"]
    assert list_held_reading_notes(read, held) == [
        "speed_left_m_s holds each reading for 5 rows of 50 Hz: it is taken at 10 Hz, without the "
        "rows that repeat a reading",
        "speed_right_m_s holds each reading for 2 rows of 50 Hz: it is taken at 25 Hz, without the "
        "rows that repeat a reading",
    ]
