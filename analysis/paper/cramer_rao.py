"""Cramér–Rao bounds of the mass: the smallest variance of an unbiased estimate from a window.

Functional errors-in-variables: force, acceleration and speed are all measured with white noise and
the true motion is unknown, so every sample satisfies f - a m - v b = 0 to within
σ² = σ_f² + m² σ_a² + b² σ_v², and cov θ ≥ σ² (ZᵀZ)⁻¹ with the noise-free regressor Z. The bound is
for estimators that treat samples as unrelated, as (7) does; using a = dv/dt could be better.
"""

import numpy as np

from analysis.simulation.scenario.scenario import SimulatedSensors
from estimators.arrays import Floats


def compute_equation_noise_std_newtons(
    sensors: SimulatedSensors, mass_kg: float, friction_N_s_m: float
) -> float:
    """Standard deviation σ in N of one sample of f - a m - v b, before any moving mean."""
    return float(
        np.sqrt(
            sensors.force_noise_N**2
            + (mass_kg * sensors.acc_noise_m_s2) ** 2
            + (friction_N_s_m * sensors.speed_noise_m_s) ** 2
        )
    )


def compute_cramer_rao_mass_bounds_kg(
    noise_N: float, sum_a_squared: Floats, sum_a_v: Floats, sum_v_squared: Floats
) -> Floats:
    """Smallest standard deviation of the mass, in kg.

    Args:
        noise_N: σ of a sample (`compute_equation_noise_std_newtons`).
        sum_a_squared: (...,) sum of the squared noise-free accelerations of the samples used.
        sum_a_v: (...,) sum of acceleration times speed.
        sum_v_squared: (...,) sum of the squared speeds.

    Returns:
        (...,) bounds in kg; infinite if the samples cannot separate mass from friction.
    """
    determinant = sum_a_squared * sum_v_squared - sum_a_v**2
    # to working precision
    known = determinant > 1e-14 * sum_a_squared * sum_v_squared
    return noise_N * np.sqrt(
        np.where(known, sum_v_squared, np.inf) / np.where(known, determinant, 1.0)
    )
