"""A force that lags behind by a fixed amount whichever way it turns, on a car that never stands."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.model.run_record import Run
from analysis.weighing.force_hysteresis import PlayHysteresis, compute_sign_of_force_change
from benchmarks.own_rate import LARGE_N, MASS_KG, Cell, logged, machine_of
from estimators.numerics.play import apply_play_hysteresis
from replay import open_log, run
from replay.logs import TimeAxis
from tests.twins import mark_slow_after

MEASURED = Cell(50.0, 20.0, derived=False)
DERIVED = Cell(20.0, 3.0, derived=True)
#: The slow rate first, whose log is the shorter.
CELLS = mark_slow_after(1, [DERIVED, MEASURED])


@pytest.fixture
def replayed(tmp_path):
    """Replay a car whose force has play of a share of its large force."""

    def of(cell: Cell, seed: int, play_share: float, **priors: float) -> Run:
        path = tmp_path / "car.csv"
        logged(cell, seed, {"force_play": play_share * LARGE_N}).write_csv(path)
        machine = machine_of(cell, stated=False)
        if priors:
            stated = machine.settings.priors.model_copy(update=priors)
            changed = machine.settings.model_copy(update={"priors": stated})
            machine = machine.model_copy(update={"settings": changed})
        return run(open_log(path, time=TimeAxis("t", "s")), machine)

    return of


def hysteresis(found: Run) -> list[dict[str, float]]:
    """Rows of the term."""
    return found.frames["nuisances"].filter(pl.col("term") == "hysteresis").to_dicts()


def deviations(found: Run) -> float:
    """Error of the mass in its standard uncertainties."""
    mass_kg, u_kg = found.frames["loads"].select("mass_kg", "u_kg").row(0)
    return (mass_kg - MASS_KG) / u_kg


@pytest.mark.heavy
@pytest.mark.parametrize("cell", CELLS, ids=str)
@pytest.mark.parametrize("seed", mark_slow_after(1, range(3100, 3104)))
def test_play_of_one_percent_is_found_corrected_and_named(replayed, cell: Cell, seed: int) -> None:
    found = replayed(cell, seed, 0.01)
    (row,) = hysteresis(found)
    assert row["posterior"] == pytest.approx(0.01 * LARGE_N, rel=0.2)
    assert abs(deviations(found)) < 2.0
    assert "hysteresis" in found.frames["findings"]["cause"]
    assert row["u_kg"] > 0.0


@pytest.mark.heavy
@pytest.mark.parametrize("cell", CELLS, ids=str)
def test_a_force_without_play_has_no_such_term(replayed, cell: Cell) -> None:
    found = replayed(cell, 3110, 0.0)
    assert not hysteresis(found)
    assert "hysteresis" not in found.frames["findings"]["cause"]


@pytest.mark.heavy
def test_a_machine_file_that_expects_it_always_has_the_term(replayed) -> None:
    (row,) = hysteresis(replayed(DERIVED, 3111, 0.0, hysteresis_share=0.01))
    assert abs(row["posterior"]) < 3.0 * row["posterior_std"]
    assert row["prior_std"] > 0.0


signals = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60).map(np.array)


@settings(deadline=None)
@given(signals, st.floats(0.0, 1e6))
def test_play_is_never_farther_away_than_half_its_width(x, half_width) -> None:
    follows = apply_play_hysteresis(x, half_width)
    assert (np.abs(x - follows) <= half_width * (1.0 + 1e-12) + 1e-9).all()
    moves = np.diff(follows) != 0.0
    assert (np.abs(x - follows)[1:][moves] >= half_width * (1.0 - 1e-9) - 1e-9).all()


def test_a_force_that_goes_on_rising_has_one_direction_until_it_turns_by_twice_the_play() -> None:
    ramp = np.concatenate([np.linspace(0.0, 1000.0, 101), np.linspace(1000.0, 0.0, 101)])
    rises = compute_sign_of_force_change(
        ramp, PlayHysteresis(half_N=50.0, mean=1, by_force_1_N=0.0)
    )
    assert rises[5:101] == pytest.approx(1.0)
    assert rises[-91:] == pytest.approx(-1.0)
    assert rises[106] == pytest.approx(0.0)
