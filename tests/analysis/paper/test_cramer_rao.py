"""The Cramér–Rao bound: textbook where only the force is noisy, and never above an estimate."""

import numpy as np
import pytest

from analysis.paper.cramer_rao import (
    compute_cramer_rao_mass_bounds_kg,
    compute_equation_noise_std_newtons,
)
from analysis.simulation.scenario.scenario import SimulatedSensors


def test_the_noise_of_the_equation_adds_what_mass_and_friction_make_of_the_regressors() -> None:
    sensors = SimulatedSensors(force_noise_N=60, acc_noise_m_s2=0.01, speed_noise_m_s=0.005)
    assert compute_equation_noise_std_newtons(sensors, 3614.0, 2891.0) == pytest.approx(
        (60**2 + 36.14**2 + 14.455**2) ** 0.5
    )


def test_it_is_the_textbook_variance_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    Z = rng.normal((0.2, 1.0), size=(200, 2))
    a, v = Z.T
    (bound,) = compute_cramer_rao_mass_bounds_kg(
        7.0, *(np.array([x @ y]) for x, y in ((a, a), (a, v), (v, v)))
    )
    assert bound == pytest.approx(7.0 * np.sqrt(np.linalg.inv(Z.T @ Z)[0, 0]))


def test_acceleration_that_is_proportional_to_speed_tells_nothing() -> None:
    v = np.linspace(0.0, 1.0, 50)
    sums = (np.array([x @ y]) for x, y in ((2 * v, 2 * v), (2 * v, v), (v, v)))
    assert np.isinf(compute_cramer_rao_mass_bounds_kg(1.0, *sums))
