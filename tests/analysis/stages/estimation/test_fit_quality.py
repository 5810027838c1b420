"""Whether a force has its sign, by the samples that the drive slows down; what a fit explains."""

import numpy as np
import pytest

from analysis.stages.estimation.fit_quality import (
    compute_fraction_of_braked_samples_with_opposing_force,
    compute_r_squared_of_means,
    fit_ungated,
)

INERTIA_KG_M2, SCRUB_N_M = 90.0, 180.0


def spin_pulses(torque_of_stop_N_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Regressor (n, 2), torque (n,) and slowing (n,) of spins to the left at three throttles."""
    rows = []
    for throttle_N_m in (240.0, 280.0, 320.0):
        rate = 0.0
        for torque_N_m, count in ((throttle_N_m, 100), (torque_of_stop_N_m, 400)):
            acc = (torque_N_m - SCRUB_N_M) / INERTIA_KG_M2
            for _ in range(count):
                rate += 0.01 * acc
                if rate <= 0.0:
                    break
                rows.append((acc, rate, torque_N_m, acc < 0.0))
    found = np.array(rows)
    return found[:, :2], found[:, 2], found[:, 3].astype(bool)


def test_scrub_that_stops_a_spin_while_the_drive_still_pushes_is_no_lost_sign() -> None:
    A, torque, slows = spin_pulses(torque_of_stop_N_m=70.0)
    assert compute_fraction_of_braked_samples_with_opposing_force(A, torque, slows, ~slows) == 0.0
    scrubbed = compute_fraction_of_braked_samples_with_opposing_force(
        A, torque, slows, ~slows, has_scrubbing_tyres=True
    )
    assert np.isnan(scrubbed)


@pytest.mark.parametrize(("sign", "fraction"), [(1.0, 0.0), (-1.0, 1.0)])
def test_a_drive_that_brakes_a_spin_still_shows_whether_it_has_a_sign(
    sign: float, fraction: float
) -> None:
    A, torque, slows = spin_pulses(torque_of_stop_N_m=-150.0)
    read = np.where(slows, sign * np.abs(torque), torque)
    found = compute_fraction_of_braked_samples_with_opposing_force(
        A, read, slows, ~slows, has_scrubbing_tyres=True
    )
    assert found == fraction


def test_means_over_a_second_explain_the_force_of_a_speed_in_steps_and_of_no_other() -> None:
    """At 10 Hz and in steps of 1 km/h the derivative of a speed is noise in every sample."""
    dice = np.random.default_rng(5)
    starts = [
        np.append(acc * np.linspace(1.0, 0.1, 60), np.zeros(10))
        for acc in dice.uniform(0.4, 1.2, 12)
    ]
    acc = np.concatenate(starts)
    moving = np.concatenate([np.append(np.ones(58), np.zeros(12)) for _ in starts]).astype(bool)
    speed = np.concatenate([np.cumsum(each) / 10.0 * (each > 0.0) for each in starts])
    coarse = np.floor(3.6 * speed) / 3.6
    A = np.column_stack([np.gradient(coarse) * 10.0, coarse])
    force = 12_000.0 * acc + 300.0 * speed + dice.normal(0.0, 100.0, acc.size)
    assert fit_ungated(A, force, moving).r_squared < 0.5
    assert compute_r_squared_of_means(A, force, moving, 10) > 0.8
    other = dice.permutation(force)
    assert compute_r_squared_of_means(A, other, moving, 10) < 0.5
