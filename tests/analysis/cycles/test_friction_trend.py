"""Friction in parts of a shift: what grows is seen, and what does not is not."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.friction_trend import fit_viscous_friction_by_shift_part
from analysis.model.settings import Settings

SETTINGS = Settings.model_validate({})
START_S, STARTS = 10.0, 240
MASSES_KG = (3600.0, 4300.0)


def driven(wear: float, noise_N: float = 40.0) -> dict[str, pl.DataFrame]:
    """Forty minutes of starts with two loads in turn; friction grows by a share `wear`."""
    random = np.random.default_rng(5)
    t = np.arange(0.0, STARTS * START_S, 0.1)
    within, number = t % START_S, (t // START_S).astype(np.int64)
    moving = within > 4.0
    speed = np.where(moving, np.minimum(within - 4.0, 2.0), 0.0) * np.where(number % 3, 1.0, -1.0)
    acceleration = np.gradient(speed, 0.1)
    mass = np.array(MASSES_KG)[number % 2]
    friction = 2800.0 * (1.0 + wear * t / t[-1])
    force = mass * acceleration + friction * speed + 90.0 + 150.0 * np.sign(speed)
    start = np.arange(STARTS) * START_S + 4.2
    return {
        "excitation": pl.DataFrame(
            {
                "t_ns": (t * 1e9).astype(np.int64),
                "force_x_N": force + random.normal(0.0, noise_N, t.size),
                "speed_x_m_s": speed,
                "regressor_acc_x_m_s2": acceleration,
                "phase": np.where(moving, "cruising", "standstill"),
            }
        ),
        "manoeuvres": pl.DataFrame(
            {
                "load_id": np.arange(STARTS) % 2,
                "start_t_ns": (start * 1e9).astype(np.int64),
                "end_t_ns": ((start + 5.5) * 1e9).astype(np.int64),
                "mass_kg": np.array(MASSES_KG)[np.arange(STARTS) % 2],
                "mass_std_kg": np.full(STARTS, 10.0),
            }
        ),
        "nuisances": pl.DataFrame({"term": ["const", "direction"], "posterior": [90.0, 150.0]}),
    }


@pytest.mark.parametrize("wear", [0.0, 0.05])
def test_parts_have_the_friction_of_their_time_within_their_deviations(wear: float) -> None:
    parts = fit_viscous_friction_by_shift_part(**driven(wear), settings=SETTINGS)
    assert len(parts) == 8
    true = [2800.0 * (1.0 + wear * (p.start_s + p.end_s) / 2.0 / 2400.0) for p in parts]
    off = [(p.friction_N_s_m - b) / p.std_N_s_m for p, b in zip(parts, true, strict=True)]
    assert np.sqrt(np.mean(np.square(off))) < 1.6
    grown = parts[-1].friction_N_s_m - parts[0].friction_N_s_m
    assert grown == pytest.approx(2800.0 * wear * 7 / 8, abs=4.0 * parts[0].std_N_s_m)


def test_a_shift_without_masses_or_of_few_starts_has_none() -> None:
    frames = driven(0.0)
    few = {**frames, "manoeuvres": frames["manoeuvres"].head(3)}
    assert fit_viscous_friction_by_shift_part(**few, settings=SETTINGS) == ()
    withheld = frames["manoeuvres"].with_columns(mass_kg=pl.lit(None, pl.Float64))
    assert (
        fit_viscous_friction_by_shift_part(**{**frames, "manoeuvres": withheld}, settings=SETTINGS)
        == ()
    )
