"""Loaded and empty by the order of the states, where their masses overlap and nothing digs."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.loaded_states import classify_loaded_states

STATES = 40
STATE_U_KG = 24.0
NO_DIGGING = pl.DataFrame(schema={"start_t_ns": pl.Int64, "end_t_ns": pl.Int64})


def classified(
    payload_kg: float,
    seed: int,
    scatter_kg: float,
    wrong: dict[int, float] | None = None,
    states: int = STATES,
) -> np.ndarray | None:
    """Of one manoeuvre a state, every second one with a load; some with a wrong mass in kg."""
    loads = payload_kg * (np.arange(states) % 2)
    mass_kg = 1670.0 + loads + np.random.default_rng(seed).normal(0.0, scatter_kg, states)
    for state, wrong_kg in (wrong or {}).items():
        mass_kg[state] = wrong_kg
    begin = np.arange(states) * 10**10
    times_ns = (begin, begin + 5 * 10**9)
    return classify_loaded_states(
        mass_kg, np.full(states, STATE_U_KG), np.arange(states), times_ns, NO_DIGGING
    )


@pytest.mark.parametrize("seed", range(5))
def test_small_loads_that_take_turns_are_told_by_that(seed: int) -> None:
    """Loads of 3.75 standard uncertainties of a state: too few for a border between masses."""
    loaded = classified(3.75 * STATE_U_KG, seed, STATE_U_KG / 2.0)
    assert loaded is not None
    assert (loaded == (np.arange(STATES) % 2 == 1)).all()


def test_many_loads_need_not_all_take_turns() -> None:
    """Of 120 states with loads of two of their uncertainties a sixth lie on the wrong side."""
    told = [classified(2.0 * STATE_U_KG, seed, STATE_U_KG, states=120) for seed in range(10)]
    shares = [
        float((each == (np.arange(120) % 2 == 1)).mean()) for each in told if each is not None
    ]
    assert len(shares) >= 8
    assert min(shares) > 0.75


@pytest.mark.parametrize("wrong_kg", [76_016.0, -4_000.0])
@pytest.mark.parametrize("state", [0, 15, STATES - 1])
def test_a_mass_that_no_machine_has_draws_no_border(state: int, wrong_kg: float) -> None:
    loaded = classified(400.0, 0, STATE_U_KG, {state: wrong_kg})
    assert loaded is not None
    others = np.arange(STATES) != state
    assert (loaded == (np.arange(STATES) % 2 == 1))[others].all()


@pytest.mark.parametrize("seed", range(5))
def test_two_masses_far_above_the_others_are_not_the_only_loads(seed: int) -> None:
    """Two states three and six loads heavier than empty: fits of few samples have such masses."""
    loaded = classified(200.0, seed, STATE_U_KG, {7: 2270.0, 21: 2870.0})
    assert loaded is not None
    assert (loaded == (np.arange(STATES) % 2 == 1)).all()


@pytest.mark.parametrize("seed", range(10))
def test_masses_that_differ_by_chance_are_not_told(seed: int) -> None:
    assert classified(0.0, seed, STATE_U_KG) is None
    assert classified(0.0, seed, STATE_U_KG, states=120) is None


def test_where_nothing_digs_the_empty_states_of_the_table_tell_the_loaded_ones() -> None:
    """Light loads beside heavy ones are loads, and what remains in the body is none."""
    payloads_kg = np.array([0.0, 5400.0, 0.0, 1600.0, 500.0, 5600.0, 20.0, 1700.0, 0.0, 5300.0])
    begin = np.arange(payloads_kg.size) * 10**10
    loaded = classify_loaded_states(
        12_000.0 + payloads_kg,
        np.full(payloads_kg.size, STATE_U_KG),
        np.arange(payloads_kg.size),
        (begin, begin + 5 * 10**9),
        NO_DIGGING,
        payloads_kg < 100.0,
    )
    assert loaded is not None
    assert (loaded == (payloads_kg > 1000.0)).all()
