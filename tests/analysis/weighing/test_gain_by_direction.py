"""Loads that go by the direction may be a force with another gain in reverse: which tells them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from analysis.weighing.gain_by_direction import (
    do_heavy_masses_scatter_more_than_light,
    do_loads_only_follow_driving_direction,
)
from analysis.weighing.growing_load import compute_max_load_loss_of_manoeuvre_kg
from analysis.weighing.load_states import LoadStates
from estimators.arrays import Bools, Floats
from tests.analysis.weighing.test_haul_patterns import drives
from tests.analysis.weighing.weighed import RICH, Weighed, merged, weighed
from tests.twins import mark_slow_after

#: To and fro, sixteen times.
TO_AND_FRO = merged(RICH, {"campaign": {"runs": 16}})
Topics = Mapping[str, pl.DataFrame]


def heavier_forwards(by_1: Sequence[float]) -> Callable[[Topics], dict[str, pl.DataFrame]]:
    """Torques of each drive forwards that are larger by a share of its own."""

    def change(topics: Topics) -> dict[str, pl.DataFrame]:
        torque, speed = topics["torque"], topics["speed"]
        mean = speed.select(pl.mean_horizontal("^speed_.*$")).to_series().to_numpy()
        at, known = (frame["header_stamp_ns"].to_numpy() for frame in (torque, speed))
        speed_m_s = np.interp(at, known, mean)
        reversed_before = np.cumsum(np.diff(speed_m_s < -0.3, prepend=False)) // 2
        share = np.resize(by_1, reversed_before[-1] + 1)[reversed_before]
        gain = pl.Series(1.0 + np.where(speed_m_s > 0.0, share, 0.0))
        return {**topics, "torque": torque.with_columns(pl.col("^torque_.*_N_m$") * gain)}

    return change


@cache
def to_and_fro(by_1: float, *stated: str, ticket: bool = False) -> Weighed:
    """A machine that drives to and fro, without a ticket unless it has one."""
    body = {"empty_mass_u_kg": 10.0, "force_gain_u": 0.001} if ticket else {"empty_mass_kg": None}
    return weighed(TO_AND_FRO, *stated, body=body, changed=heavier_forwards((by_1,)))


def findings(log: Weighed) -> dict[str, str]:
    """Evidence by cause."""
    return {row["cause"]: row["evidence"] for row in log.replayed.frames["findings"].to_dicts()}


@pytest.mark.heavy
@pytest.mark.parametrize("by_1", mark_slow_after(1, [0.05, 0.02, 0.1]))
def test_a_constant_load_whose_force_has_another_gain_in_reverse_counts_no_cycle(
    by_1: float,
) -> None:
    log = to_and_fro(by_1)
    assert log.weighing.fit.mass_count > 1
    assert "this log cannot distinguish the two" in findings(log)["gain_by_direction"]
    assert log.replayed.frames["loads"]["withheld"].all()
    assert not log.replayed.frames["cycles"]["counted"].any()


@pytest.mark.heavy
@pytest.mark.parametrize("starts", mark_slow_after(1, [8, 5]))
def test_a_gain_that_friction_leaves_uncertain_may_still_be_all_the_loads(starts: int) -> None:
    """Starts at full throttle tell a gain by direction from friction by a hundredth only."""
    alike = merged(TO_AND_FRO, {"campaign": {"runs": starts}, "starts": {"throttle_least": 1.0}})
    log = weighed(alike, body={"empty_mass_kg": None}, changed=heavier_forwards((0.05,)))
    found = log.weighing.by_direction
    assert log.weighing.fit.mass_count == starts
    assert found is not None
    assert abs(found.gain_1 - 1.0 / 1.05) < 3.0 * found.std_1
    assert found.std_1 > 0.008
    assert log.replayed.frames["loads"]["withheld"].all()


@pytest.mark.heavy
def test_the_gain_that_is_said_is_that_of_the_log() -> None:
    found = to_and_fro(0.05).weighing.by_direction
    assert found is not None
    assert found.gain_1 == pytest.approx(1.0 / 1.05, abs=3.0 * found.std_1)


@pytest.mark.heavy
def test_a_gain_that_is_stated_is_taken_off_the_force() -> None:
    log = to_and_fro(0.05, f"machine.force_gain_in_reverse={1.0 / 1.05}")
    assert log.weighing.fit.mass_count == 1
    assert log.load["mass_kg"] == pytest.approx(1.05 * log.true_kg, abs=3.0 * log.load["u_kg"])
    assert "gain_by_direction" not in findings(log)


@pytest.mark.heavy
def test_who_states_that_both_directions_are_alike_has_loads() -> None:
    log = to_and_fro(0.05, "machine.force_gain_in_reverse=1.0")
    assert log.weighing.by_direction is None
    assert log.weighing.fit.mass_count > 1


@pytest.mark.heavy
def test_a_gain_that_leaves_one_load_is_in_its_uncertainty() -> None:
    log = to_and_fro(-0.05)
    assert log.weighing.fit.mass_count == 1
    assert log.causes["gain_by_direction"] == pytest.approx(0.05 * log.true_kg / 3.0**0.5, rel=0.2)
    assert abs(log.error_u) < 2.0
    assert log.verdict.can_weigh


@pytest.mark.heavy
def test_who_states_a_single_load_has_one_with_the_gain_in_its_uncertainty() -> None:
    log = to_and_fro(0.05, "settings.loads.single_load=true")
    assert log.weighing.fit.mass_count == 1
    assert log.causes["gain_by_direction"] == pytest.approx(0.05 * log.true_kg / 3.0**0.5, rel=0.2)
    assert abs(log.error_u) < 2.0
    assert log.verdict.can_weigh


@pytest.mark.heavy
def test_an_empty_machine_on_a_ticket_tells_loads() -> None:
    assert to_and_fro(0.05).weighing.by_direction is not None
    assert to_and_fro(0.05, ticket=True).weighing.by_direction is None


@pytest.mark.heavy
def test_a_load_of_a_half_of_the_machine_is_no_gain() -> None:
    assert to_and_fro(0.5).weighing.by_direction is None


@pytest.mark.heavy
def test_a_log_without_such_a_gain_has_none() -> None:
    log = to_and_fro(0.0)
    assert log.weighing.by_direction is None
    assert log.weighing.fit.mass_count == 1


@pytest.mark.heavy
def test_one_turn_is_too_few_to_tell() -> None:
    few = {"campaign": {"runs": 2}}
    assert weighed(merged(RICH, few)).weighing.by_direction is None


def levels(light_kg: Sequence[float], heavy_kg: Sequence[float]) -> tuple[LoadStates, Bools]:
    """Manoeuvres of an empty and of a loaded direction, each weighed to ± 10 kg."""
    level = np.array([*light_kg, *heavy_kg])
    of, std = np.zeros(level.size, np.int64), np.full(level.size, 10.0)
    states = LoadStates(np.arange(level.size), of, level, std, 0.0, level.size - 1.0, 1.0)
    return states, np.arange(level.size) >= len(light_kg)


def hauls(kinds: Sequence[float], *, empty: bool = False) -> SimpleNamespace:
    """A fit of loads that go by the direction: ± m of each drive; a boom moves after the odd."""
    motion = drives([24.0 * kind for kind in kinds], tuple(range(0, len(kinds), 2)))
    level = np.where(np.array(kinds) > 0.0, 0.0, 300.0)
    states, _ = levels(level.tolist(), [])
    states = replace(states, state_of_manoeuvre=np.append(0, np.cumsum(np.diff(level) != 0.0)))
    named = np.zeros(motion.manoeuvre_of_sample.size, np.bool_) if empty else None
    return SimpleNamespace(states=states, motion=replace(motion, empty=named))


def test_a_boom_that_moves_or_times_named_empty_tell_loads() -> None:
    to_and_fro_hauls = hauls([1.0, -1.0] * 6)
    still = replace(to_and_fro_hauls.motion, boom_and_bucket_angles_rad=())
    unseen = SimpleNamespace(states=to_and_fro_hauls.states, motion=still)
    named = SimpleNamespace(states=unseen.states, motion=hauls([1.0, -1.0] * 6, empty=True).motion)
    seen = [
        do_loads_only_follow_driving_direction(fit) for fit in (unseen, to_and_fro_hauls, named)
    ]  # pyright: ignore
    assert seen == [True, False, False]


def test_loads_that_are_hauled_both_ways_are_no_gain() -> None:
    """In reverse and forwards with the load, then in reverse and forwards without it."""
    both = hauls([-1.0, 1.0, -1.0, 1.0] * 4)
    level = np.resize([300.0, 300.0, 0.0, 0.0], 16)
    states = replace(both.states, manoeuvre_mass_kg=level, state_of_manoeuvre=np.arange(16) // 2)
    motion = replace(both.motion, boom_and_bucket_angles_rad=())
    fit = SimpleNamespace(states=states, motion=motion)
    assert not do_loads_only_follow_driving_direction(fit)  # pyright: ignore


def test_payloads_scatter_where_the_empty_machine_does_not() -> None:
    empty, loads = [-9.0, 4.0, 11.0, -6.0, 2.0, -3.0], [-60.0, 40.0, 75.0, -20.0, -55.0, 30.0]
    assert do_heavy_masses_scatter_more_than_light(*levels(empty, loads))
    # both directions scatter alike, or the lighter one more: neither is what payloads do
    assert not do_heavy_masses_scatter_more_than_light(*levels(loads, loads[::-1]))
    assert not do_heavy_masses_scatter_more_than_light(*levels(loads, empty))


def test_a_machine_loses_no_more_than_it_carries() -> None:
    """Of loads of 0 and 3 t an empty start loses nothing, and a loaded one 3 t at most."""
    states = replace(levels([0.0, 0.0], [0.0])[0], state_of_manoeuvre=np.array([0, 1, 0]))
    fit = _TwoLoads(states)
    assert [compute_max_load_loss_of_manoeuvre_kg(fit, unit) for unit in (0, 1, 2)] == [
        0.0,
        3050.0,
        0.0,
    ]  # pyright: ignore


@dataclass(frozen=True)
class _TwoLoads:
    """A fit with an empty state and one of 3 t, whose difference is known to ± 50 kg."""

    states: LoadStates
    mass_count: int = 2

    @property
    def masses_kg(self) -> Floats:
        return np.array([12_000.0, 15_000.0])

    def make_mass_coefficients_of_state(self, state: int) -> Floats:
        return np.eye(2)[state]

    def compute_mass_sum_u_kg(self, weights: Floats) -> float:
        return 50.0 * float(np.abs(weights).any())
