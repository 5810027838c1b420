"""Starts into a pile are told from starts of heavy, stiff or slow machines."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.stages.gating.digging import (
    find_digging_starts,
    mark_slowing_before_driving,
    reject_windows_with_digging,
    select_longest_part_without_stop,
)
from replay import load_machine, open_log, run
from replay.logs import TimeAxis
from tests.analysis.without_bucket import WITHOUT_BUCKET
from tests.twins import mark_heavy_after, mark_slow_after

MACHINE = load_machine(Path("cat262c.toml"))
RATE_HZ = 100
THROTTLE_N = 5000.0


def against_a_pile(
    mass_kg: float, friction_N_s_m: float, constant_N: float, pile_N: np.ndarray
) -> np.ndarray:
    """The acceleration under a throttle that is held: up, and down again as the pile grows."""
    speed, found = 0.0, []
    for resistance_N in pile_N:
        net_N = THROTTLE_N - friction_N_s_m * speed - constant_N - resistance_N
        found.append(net_N / mass_kg)
        speed += found[-1] / RATE_HZ
    return np.array(found)


def starts(
    masses_kg: list[float],
    friction_N_s_m: float,
    constant_N: float,
    piles_N: list[float],
    free_s: float = 0.0,
    lasts_s: float = 4.0,
) -> pl.DataFrame:
    """One start a mass, its force what the equation asks for, and a pile's resistance on top.

    The pile is met after `free_s`, and grows until the start's end.
    """
    parts: list[pl.DataFrame] = []
    random = np.random.default_rng(1)
    for mass, pile in zip(masses_kg, piles_N, strict=True):
        t = np.arange(0.0, lasts_s, 1.0 / RATE_HZ)
        acceleration = 1.5 * np.exp(-t / 1.2)
        pile_N = pile * np.maximum(t - free_s, 0.0) / (lasts_s - free_s)
        if pile:
            acceleration = against_a_pile(mass, friction_N_s_m, constant_N, pile_N)
        speed = np.cumsum(acceleration) / RATE_HZ
        force = mass * acceleration + friction_N_s_m * speed + constant_N + pile_N
        slows = acceleration < -0.05  # the phase takes it for braking
        moving = pl.DataFrame(
            {
                "regressor_acc_x_m_s2": acceleration,
                "speed_x_m_s": speed,
                "force_x_N": force + random.normal(0.0, 30.0, t.size),
                "phase": np.where(slows, "braking", "accelerating"),
            }
        )
        stand = pl.DataFrame(
            {name: np.zeros(300) for name in moving.columns if name != "phase"}
        ).with_columns(phase=pl.lit("standstill"))
        parts += [stand, moving]
    frame = pl.concat(parts)
    return frame.with_columns(t_ns=pl.int_range(frame.height) * (10**9 // RATE_HZ))


@pytest.mark.heavy
@given(
    st.lists(st.floats(3600.0, 4700.0), min_size=3, max_size=6),
    st.floats(0.0, 2000.0),
    st.floats(0.0, 1000.0),
)
def test_no_start_without_a_pile_digs(
    masses: list[float], friction: float, constant: float
) -> None:
    frame = starts(masses, friction, constant, [0.0] * len(masses))
    assert find_digging_starts(frame, MACHINE).is_empty()


@pytest.mark.heavy
@given(
    st.floats(3600.0, 4700.0),
    st.floats(0.0, 600.0),
    st.floats(0.0, 500.0),
    st.floats(5500.0, 7000.0),
    st.floats(0.5, 1.5),
)
def test_a_pile_that_is_met_at_speed_and_slows_the_machine_down_is_told(
    mass: float, friction: float, constant: float, pile: float, free_s: float
) -> None:
    frame = starts([mass] * 3, friction, constant, [pile] * 3, free_s)
    assert "braking" in frame["phase"].unique()
    assert find_digging_starts(frame, MACHINE).height == 3


def test_nobody_drives_into_a_pile_at_the_speed_of_a_road() -> None:
    frame = starts([3900.0] * 3, 400.0, 150.0, [6000.0] * 3, 1.0)
    assert find_digging_starts(frame, MACHINE).height == 3
    fast = frame.with_columns(pl.col("speed_x_m_s") * 6.0)
    assert find_digging_starts(fast, MACHINE).is_empty()


@pytest.mark.heavy
@given(st.floats(3000.0, 6000.0))
def test_a_move_of_a_second_digs_nowhere_however_its_force_grows(growth: float) -> None:
    frame = starts([3600.0] * 3, 400.0, 150.0, [growth] * 3, lasts_s=1.1)
    assert find_digging_starts(frame, MACHINE).is_empty()


def test_what_grows_by_more_than_the_machine_can_drive_with_is_no_pile() -> None:
    frame = starts([3600.0] * 12, 400.0, 150.0, [0.0] * 12)
    driving, t_s = pl.col("phase") != "standstill", pl.col("t_ns") / 1e9 % 7.0
    # a speed that falls while the force stays small: no pile does that
    pushed = pl.when(driving & (t_s > 3.0)).then(15_000.0 * (t_s - 3.0) / 4.0).otherwise(0.0)
    second = (pl.col("t_ns") / 1e9).is_between(7.0, 14.0)
    odd = frame.with_columns(
        regressor_acc_x_m_s2=pl.when(second)
        .then(pl.col("regressor_acc_x_m_s2") - pushed / 3600.0)
        .otherwise("regressor_acc_x_m_s2")
    )
    assert find_digging_starts(odd, MACHINE).is_empty()


def test_starts_into_a_pile_dig_and_their_windows_are_refused_with_the_reason() -> None:
    frame = starts([3600.0, 3900.0, 4300.0], 400.0, 150.0, [0.0, 4000.0, 0.0])
    digs = find_digging_starts(frame, MACHINE)
    assert digs.height == 1
    assert digs["start_t_ns"][0] == pytest.approx(10.0e9, abs=0.1e9)
    gated = pl.DataFrame(
        {
            "t_ns": frame["t_ns"],
            "accepted_x": [True] * frame.height,
            "reason_x": ["accepted"] * frame.height,
        }
    )
    left = reject_windows_with_digging(gated, frame, digs, MACHINE)
    seconds = left["t_ns"] / 1e9
    refused = left.filter(~pl.col("accepted_x"))
    assert set(refused["reason_x"]) == {"digging"}
    assert left.filter(seconds.is_between(10.5, 13.5))["accepted_x"].any() is False
    assert left.filter(seconds < 9.0)["accepted_x"].all()


def test_a_force_that_reads_nothing_digs_nowhere() -> None:
    frame = starts([3600.0] * 3, 400.0, 150.0, [0.0] * 3).with_columns(force_x_N=pl.lit(0.0))
    assert find_digging_starts(frame, MACHINE).is_empty()


def turned_back(frame: pl.DataFrame) -> pl.DataFrame:
    """The same driven backwards."""
    return frame.with_columns(-pl.col("regressor_acc_x_m_s2", "speed_x_m_s", "force_x_N"))


def one_after_the_other(*frames: pl.DataFrame) -> pl.DataFrame:
    frame = pl.concat([each.drop("t_ns") for each in frames])
    return frame.with_columns(t_ns=pl.int_range(frame.height) * (10**9 // RATE_HZ))


def test_a_machine_that_does_not_dig_has_no_pile() -> None:
    body = MACHINE.machine.model_copy(update={"digs": False})
    frame = starts([3600.0] * 3, 400.0, 150.0, [4000.0] * 3)
    assert find_digging_starts(frame, MACHINE).height == 3
    assert find_digging_starts(frame, MACHINE.model_copy(update={"machine": body})).is_empty()


def test_what_pushes_back_whichever_way_the_machine_goes_is_no_pile() -> None:
    ahead = starts([3600.0] * 4, 400.0, 150.0, [4000.0] * 4)
    assert (
        find_digging_starts(turned_back(ahead), MACHINE).height == 4
    )  # a log with its signs turned round
    assert find_digging_starts(one_after_the_other(ahead, turned_back(ahead)), MACHINE).is_empty()


def test_a_resistance_that_falls_as_often_is_no_pile() -> None:
    grows = starts([3600.0] * 4, 400.0, 150.0, [4000.0] * 4)
    pushed = starts([3600.0] * 4, 400.0, 4000.0, [0.0] * 4)
    since_s = (pl.col("t_ns") / 1e9 % 7.0 - 3.0).clip(0.0)
    falls = pushed.with_columns(force_x_N=pl.col("force_x_N") - 1000.0 * since_s)
    assert find_digging_starts(one_after_the_other(grows, falls), MACHINE).is_empty()


def test_a_machine_that_drives_on_is_in_no_pile() -> None:
    frame = starts([3600.0] * 4, 400.0, 150.0, [4000.0] * 4)
    rolls = pl.col("phase") == "standstill"
    # it rolls between the starts, and does not stand
    rolling = frame.with_columns(
        speed_x_m_s=pl.when(rolls).then(1.0).otherwise(pl.col("speed_x_m_s") + 1.0),
        force_x_N=pl.col("force_x_N") + 400.0,
        phase=pl.when(rolls).then(pl.lit("braking")).otherwise("phase"),
    )
    assert find_digging_starts(frame, MACHINE).height == 4
    # the end of the log does not say whether it drives on
    assert find_digging_starts(rolling, MACHINE).height <= 1


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, range(3)))
@pytest.mark.parametrize("name", mark_heavy_after(1, WITHOUT_BUCKET))
def test_machines_without_a_bucket_have_no_pile(name: str, seed: int, tmp_path: Path) -> None:
    drawn = WITHOUT_BUCKET[name](seed)
    path = tmp_path / "drawn.parquet"
    drawn.table.write_parquet(path)
    with open_log(path, time=TimeAxis("t")) as log:
        made = run(log, drawn.machine)
    assert made.frames["digging"].is_empty()
    assert "external_force" not in set(made.frames["findings"]["cause"])


def test_slowing_counts_from_its_beginning_where_the_force_rises_or_the_machine_drives_on() -> None:
    def marked(pushes: str, hard: str, drives: str) -> str:
        flags = (np.array([each == "1" for each in text]) for text in (pushes, hard, drives))
        return "".join("1" if each else "0" for each in mark_slowing_before_driving(*flags))

    assert marked("0111110", "0000110", "1000000") == "0111110"
    assert marked("0111000", "0000000", "1000111") == "0111000"
    # a throttle that is let go: hard first, and soft as the force falls
    assert marked("0111110", "0110000", "1000000") == "0110000"
    assert marked("0111110", "0000000", "1000000") == "0000000"


def test_what_lurches_after_a_stop_is_not_judged() -> None:
    rows = np.concatenate([np.arange(10, 90), np.arange(100, 108)])
    stands = np.zeros(120, np.bool_)
    stands[90:100] = True
    so_far = np.cumsum(stands, dtype=np.int64)
    assert select_longest_part_without_stop(rows, so_far).tolist() == list(range(10, 90))
    # parts too short for a start are judged together
    assert select_longest_part_without_stop(rows[76:], so_far).tolist() == rows[76:].tolist()
