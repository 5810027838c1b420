"""A speed that reads 0 below a threshold: the step is a gap, and other speeds stay as they are."""

import numpy as np
import pytest

from analysis.diagnosis.measured_channels import find_zero_speed_spans
from analysis.stages.signals.speed_threshold import (
    drop_zero_readings_beside_motion,
    estimate_zero_speed_threshold_m_s,
    find_zero_speed_thresholds_m_s,
    list_speed_threshold_notes,
)

RATE_HZ = 50.0
ROWS = 12_000
T_NS = (np.arange(ROWS) / RATE_HZ * 1e9).astype(np.int64)
DICE = np.random.default_rng(21)


def drive(period_s: float = 30.0) -> np.ndarray:
    """Speed (n,) in m/s of starts and stops, half of the time at a stand."""
    t_s = np.arange(ROWS) / RATE_HZ
    return np.clip(-5.0 * np.sin(2.0 * np.pi * t_s / period_s), 0.0, 4.0)


def reads_from(threshold_m_s: float, speed_m_s: np.ndarray) -> np.ndarray:
    return np.where(np.abs(speed_m_s) < threshold_m_s, 0.0, speed_m_s)


@pytest.mark.parametrize("threshold_m_s", [0.15, 0.3, 0.6])
@pytest.mark.parametrize("std", [0.0, 0.01])
def test_a_threshold_is_estimated(threshold_m_s: float, std: float) -> None:
    noisy = drive() + np.where(drive() > 0.0, DICE.normal(0.0, std, ROWS), 0.0)
    found = estimate_zero_speed_threshold_m_s(reads_from(threshold_m_s, noisy))
    assert found == pytest.approx(threshold_m_s, rel=0.1, abs=0.02)


@pytest.mark.parametrize(
    "speed_m_s",
    [
        drive(),
        drive() + DICE.normal(0.0, 0.02, ROWS),
        np.round(drive() / 0.0139) * 0.0139,
        drive()[::50],  # at 1 Hz a start is a step as well
        np.zeros(ROWS),
        # it never stands, and drops out three times
        np.where(np.isin(np.arange(ROWS) // 50, [40, 90, 150]), 0.0, 6.0 + drive()),
    ],
    ids=["exact", "noisy", "coarse", "slow", "standing", "dropouts"],
)
def test_other_speeds_have_no_threshold(speed_m_s: np.ndarray) -> None:
    assert estimate_zero_speed_threshold_m_s(speed_m_s) == 0.0


def test_readings_beside_motion_are_left_out_and_those_of_a_stand_stay() -> None:
    read = {"speed_x_m_s": (T_NS, reads_from(0.3, drive())), "force_x_N": (T_NS, drive())}
    thresholds = find_zero_speed_thresholds_m_s(read)
    assert thresholds == {"speed_x_m_s": pytest.approx(0.3, rel=0.1)}
    kept = drop_zero_readings_beside_motion(read, thresholds)
    t_ns, x = kept["speed_x_m_s"]
    steps_s = np.diff(t_ns) / 1e9
    beside = np.abs(np.diff((x != 0.0).astype(int))) == 1
    # longer than a gap that is interpolated, of three periods
    assert steps_s[beside].min() > 3.0 / RATE_HZ
    assert steps_s[~beside].max() == pytest.approx(1.0 / RATE_HZ)
    assert np.count_nonzero(x == 0.0) > 0.9 * np.count_nonzero(read["speed_x_m_s"][1] == 0.0)
    assert kept["force_x_N"] is read["force_x_N"]
    assert "0 below 0.3" in list_speed_threshold_notes(thresholds)[0]


def test_short_drives_are_not_lost_to_the_gap() -> None:
    assert not find_zero_speed_thresholds_m_s({"speed_x_m_s": (T_NS, reads_from(0.3, drive(12.0)))})


@pytest.mark.parametrize("threshold_m_s", [0.15, 0.6])
def test_a_stand_below_a_threshold_is_no_dropout(threshold_m_s: float) -> None:
    stands = find_zero_speed_spans(T_NS, reads_from(threshold_m_s, drive()))
    stood_s = sum(end - begin for begin, end in stands) / 1e9
    assert stood_s > 0.5 * ROWS / RATE_HZ - 1.0


def test_a_dropout_from_full_speed_is_no_stand() -> None:
    speed = reads_from(0.3, drive())
    fastest = int(np.argmax(speed))
    before = find_zero_speed_spans(T_NS, speed)
    speed[fastest : fastest + 25] = 0.0
    assert find_zero_speed_spans(T_NS, speed) == before


def test_a_speed_of_1_hz_stands_where_it_stopped_from_one_reading_to_the_next() -> None:
    """At 0.9 m/s² the reading before a stand is up to 0.9 m/s, and no sensor froze."""
    drive_m_s = np.concatenate([np.arange(0.9, 8.0, 0.9), np.arange(7.2, 0.0, -0.9)])
    speed = np.concatenate([np.zeros(20), drive_m_s, np.zeros(20), drive_m_s, np.zeros(20)])
    t_ns = np.arange(speed.size) * 10**9
    stands = find_zero_speed_spans(t_ns, speed)
    assert [round((end - begin) / 1e9) for begin, end in stands] == [19, 19, 19]


def test_a_speed_of_1_hz_that_falls_to_0_under_way_does_not_stand() -> None:
    drive_m_s = np.concatenate([np.arange(0.9, 8.0, 0.9), np.arange(7.2, 0.0, -0.9)])
    speed = np.concatenate([np.zeros(20), drive_m_s, np.zeros(20), drive_m_s, np.zeros(20)])
    speed[26:33] = 0.0
    stands = find_zero_speed_spans(np.arange(speed.size) * 10**9, speed)
    assert [round((end - begin) / 1e9) for begin, end in stands] == [19, 19, 19]


def test_an_averaged_speed_of_1_hz_that_drops_out_often_does_not_stand() -> None:
    """At each dropout it falls by half: of all steps, too many to be braking."""
    generator = np.random.default_rng(5)
    speed = 8.0 + 0.1 * generator.normal(size=900)
    for first in range(20, 880, 22):
        speed[first : first + 5] = [4.0, 0.0, 0.0, 0.0, 4.0]
    assert not find_zero_speed_spans(np.arange(speed.size) * 10**9, speed)
