"""Terms that the model does not have widen the mass by what they would move it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from analysis.model.run_record import Run
from analysis.weighing.missing_terms import ELASTICITY, MissingTerm
from analysis.weighing.nuisances import CURVATURE, Nuisance
from benchmarks.own_rate import LARGE_N, MASS_KG, Cell, logged, machine_of
from replay import open_log, run
from replay.logs import TimeAxis
from tests.twins import mark_slow_after

MEASURED = Cell(100.0, 20.0, derived=False)
DERIVED = Cell(50.0, 5.0, derived=True)
LOW_GEAR_M_S = 12.0


def saturate(log: pl.DataFrame) -> pl.DataFrame:
    """Read the force with a sensor that saturates softly, by ten per cent at the largest force."""
    return log.with_columns(force=pl.col("force") / (1.0 + 0.1 * pl.col("force").abs() / LARGE_N))


def compress(log: pl.DataFrame) -> pl.DataFrame:
    """Read the force by an amplifier that gives out at 1.25 times the largest force."""
    limit_N = LARGE_N / 0.8
    return log.with_columns(force=limit_N * (pl.col("force") / limit_N).tanh())


def lose_in_low_gear(log: pl.DataFrame) -> pl.DataFrame:
    """Read the force before a low gear that loses six per cent of it."""
    lost = pl.when(pl.col("speed").abs() < LOW_GEAR_M_S).then(1.0 / 0.94).otherwise(1.0)
    return log.with_columns(force=pl.col("force") * lost)


def read_speed_low_at_the_top(log: pl.DataFrame) -> pl.DataFrame:
    """Read the speed with wheels that grow by one per cent at the largest speed."""
    top = np.abs(log["speed"].to_numpy()).max()
    return log.with_columns(speed=pl.col("speed") / (1.0 + 0.01 * (pl.col("speed") / top) ** 2))


@pytest.fixture
def replayed(tmp_path):
    """Replay a car whose log is changed."""

    def of(cell: Cell, seed: int, change=lambda log: log) -> Run:
        path = tmp_path / "car.csv"
        change(logged(cell, seed)).write_csv(path)
        return run(open_log(path, time=TimeAxis("t", "s")), machine_of(cell, stated=False))

    return of


def deviations(found: Run) -> float:
    """Error of the mass in its standard uncertainties."""
    mass_kg, u_kg = found.frames["loads"].select("mass_kg", "u_kg").row(0)
    return (mass_kg - MASS_KG) / u_kg


def missing_term_kg(found: Run) -> float:
    """Uncertainty by terms that the model lacks; 0 if none is significant."""
    part = found.frames["budget"].filter(pl.col("cause") == "missing_term", pl.col("load_id") == 0)
    return 0.0 if part.is_empty() else part["u_kg"][0]


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, range(3300, 3304)))
@pytest.mark.parametrize(
    ("cell", "change"),
    mark_slow_after(
        1,
        [
            (DERIVED, read_speed_low_at_the_top),
            (MEASURED, lose_in_low_gear),
            (MEASURED, saturate),
        ],
    ),
)
def test_a_force_or_speed_that_is_not_linear_widens_and_is_named(
    replayed, cell: Cell, change, seed: int
) -> None:
    found = replayed(cell, seed, change)

    assert missing_term_kg(found) > 0.0
    assert abs(deviations(found)) < 3.0
    assert "gain_by_speed" in found.frames["findings"]["cause"]


@pytest.mark.parametrize(
    ("t", "effect_kg", "is_significant"),
    [
        # its effect is known to 2 % of the mass
        (3.5, 200.0, True),
        (2.5, 100.0, False),
        # to 3 %: it may be collinear with others, unless it is beyond doubt
        (5.0, 600.0, False),
        (9.0, 1080.0, True),
        # to 6 %
        (9.0, 2160.0, False),
    ],
)
def test_a_term_counts_if_the_log_tells_what_it_moves_and_the_less_the_surer_it_is(
    t: float, effect_kg: float, is_significant: bool
) -> None:
    fit = SimpleNamespace(masses_kg=np.array([4000.0]))
    term = MissingTerm(CURVATURE, 0.1, t, np.array([-effect_kg]))

    assert term.is_significant(fit) == is_significant  # pyright: ignore[reportArgumentType]


def test_a_term_that_cannot_be_what_it_is_said_to_be_is_not_named() -> None:
    def make(term: Nuisance, value: float, rms_N: float, ratio: float = 1.0) -> MissingTerm:
        return MissingTerm(term, value, 20.0, np.array([-50.0]), rms_N, ratio)

    saturation = replace(CURVATURE, name="force_saturation")
    beside = make(CURVATURE, 0.1, 90.0)
    belt = make(ELASTICITY, 1e-4, 80.0)
    assert belt.is_nameable((belt, beside))
    assert not replace(belt, residual_rms_N=100.0).is_nameable((belt, beside))
    assert make(saturation, 0.15, 80.0).is_nameable(())
    assert not make(saturation, 0.6, 80.0).is_nameable(())
    assert not make(CURVATURE, 0.1, 80.0, ratio=0.4).is_nameable(())


@pytest.mark.heavy
def test_a_force_that_no_term_describes_is_named_by_its_curvature(replayed) -> None:
    findings = replayed(MEASURED, 3300, compress).frames["findings"]

    (evidence,) = findings.filter(cause="gain_by_speed")["evidence"]
    assert "not linear in the acceleration" in evidence


@pytest.mark.heavy
@pytest.mark.parametrize("cell", mark_slow_after(1, [DERIVED, MEASURED]), ids=str)
@pytest.mark.parametrize("seed", mark_slow_after(1, range(3310, 3313)))
def test_a_sound_log_is_not_widened(replayed, cell: Cell, seed: int) -> None:
    found = replayed(cell, seed)

    assert missing_term_kg(found) == 0.0
    assert abs(deviations(found)) < 3.0
    assert "gain_by_speed" not in found.frames["findings"]["cause"]
