"""Numbers for the verdict: how well the ungated samples of an axis fit its model."""

from typing import NamedTuple

import numpy as np

from analysis.model.windows import list_whole_blocks_of_runs
from analysis.stages.stage_limits import LIMITS
from estimators.arrays import Bools, Floats
from estimators.methods import pooled


class UngatedFit(NamedTuple):
    """A fit over every moving sample: first parameter, its standard deviation and R²."""

    value: float
    std: float
    r_squared: float


def has_enough_moving_samples(A: Floats, is_moving: Bools) -> bool:
    """Whether the moving samples are enough for the fit to decide a check."""
    return bool(is_moving.sum() >= LIMITS.samples_per_parameter * A.shape[1])


def fit_ungated(A: Floats, f: Floats, is_moving: Bools) -> UngatedFit:
    """First parameter, its standard deviation and R² of a fit over every moving sample."""
    if not has_enough_moving_samples(A, is_moving):
        return UngatedFit(float("nan"), float("nan"), float("nan"))
    traced = pooled.estimate_along_log(A, f, np.where(is_moving, 0, -1))
    residual = f[is_moving] - A[is_moving] @ traced.theta[0]
    r_squared = _compute_r_squared(residual, f[is_moving])
    return UngatedFit(float(traced.theta[0, 0]), float(traced.std[0, 0]), r_squared)


def _compute_r_squared(residual: Floats, f: Floats) -> float:
    """Fraction of the force's variance that a fit explains; NaN for a constant force."""
    total = float(((f - f.mean()) ** 2).sum())
    return 1.0 - float(residual @ residual) / total if total > 0 else float("nan")


def compute_r_squared_of_means(A: Floats, f: Floats, is_moving: Bools, rows_per_mean: int) -> float:
    """R² of least squares over means of consecutive moving samples; NaN if they are too few."""
    spans = list_whole_blocks_of_runs(is_moving, rows_per_mean)
    if len(spans) < LIMITS.samples_per_parameter * A.shape[1]:
        return float("nan")
    means = np.array([[*A[span].mean(axis=0), f[span].mean()] for span in spans])
    columns, force = means[:, :-1], means[:, -1]
    residual = force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
    return _compute_r_squared(residual, force)


def compute_partial_correlation(A: Floats, f: Floats, is_moving: Bools) -> float:
    """Correlation of a and F after regressing both on the other columns and a constant."""
    if not has_enough_moving_samples(A, is_moving):
        return float("nan")
    others = np.column_stack([A[is_moving, 1:], np.ones(int(is_moving.sum()))])
    both = np.column_stack([A[is_moving, 0], f[is_moving]])
    rest = both - others @ np.linalg.lstsq(others, both, rcond=None)[0]
    norms = np.sqrt((rest**2).sum(axis=0))
    return float(rest[:, 0] @ rest[:, 1] / norms.prod()) if norms.all() else float("nan")


def compute_fraction_of_samples_with_force_along_motion(
    speed: Floats, f: Floats, chosen_samples: Bools
) -> float:
    """Fraction of the samples whose force acts along the motion."""
    return (
        float((speed[chosen_samples] * f[chosen_samples] >= 0).mean())
        if chosen_samples.any()
        else float("nan")
    )


def compute_fraction_of_braked_samples_with_opposing_force(
    A: Floats,
    f: Floats,
    is_braking: Bools,
    is_speeding_up: Bools,
    raw_force: Floats | None = None,
    *,
    has_scrubbing_tyres: bool = False,
) -> float:
    """Fraction of the samples braked by the drive whose force opposes the motion.

    Mass and friction are fitted to the samples that speed up. A sample is braked if it slows down
    by more than friction alone would, and it is judged if its force is not small. If no more than
    half of the braked samples have such a force, no sensor measures the brakes, and offset and
    losses decide the sign of small forces. If the fit explains less than half of the variance of
    the force, every sample that slows down counts as braked; if too few samples speed up for a
    fit, small forces are judged as well.

    Args:
        A: (n, 2) acceleration and speed of an axis.
        f: (n,) force or torque.
        is_braking: (n,) samples that slow down.
        is_speeding_up: (n,) samples that speed up.
        raw_force: (n,) the same force before it was filtered, whose sign is judged; None judges
            `f`.
        has_scrubbing_tyres: whether Coulomb friction is part of the friction: it stops a spin.

    Returns:
        The fraction; NaN where the drive does not brake or no sensor measures it.
    """
    judged = f if raw_force is None else raw_force
    if not has_enough_moving_samples(A, is_speeding_up):
        return 1.0 - compute_fraction_of_samples_with_force_along_motion(
            A[:, 1], judged, is_braking
        )
    own = f[is_speeding_up]
    model = np.column_stack([A, np.sign(A[:, 1])]) if has_scrubbing_tyres else A
    expected = model @ np.linalg.lstsq(model[is_speeding_up], own, rcond=None)[0]
    least = LIMITS.signed_force_fraction * float(np.quantile(np.abs(own), 0.95))
    braked = is_braking
    if float(np.var(own - expected[is_speeding_up])) < LIMITS.explained_variance_fraction * float(
        np.var(own)
    ):
        braked = is_braking & (-np.sign(A[:, 1]) * expected > least)
    seen = braked & (np.abs(judged) > least)
    if np.count_nonzero(seen) <= LIMITS.signed_braking_fraction * np.count_nonzero(braked):
        return float("nan")
    return 1.0 - compute_fraction_of_samples_with_force_along_motion(A[:, 1], judged, seen)


def fit_slope_with_noisy_x(x: Floats, y: Floats, is_used: Bools, x_noise: float = 0.0) -> float:
    """Slope of y on x about their means, over the finite samples; NaN if there are too few.

    Args:
        x: (n,) abscissae.
        y: (n,) ordinates.
        is_used: (n,) samples to use.
        x_noise: variance of the noise of x; the attenuation that it causes is corrected.
    """
    is_used = is_used & np.isfinite(x) & np.isfinite(y)
    if is_used.sum() < LIMITS.samples_per_parameter:
        return float("nan")
    x, y = x[is_used] - x[is_used].mean(), y[is_used] - y[is_used].mean()
    squares = float(x @ x)
    squares_without_noise = max(squares - x_noise * x.size, LIMITS.min_variance_fraction * squares)
    return float(x @ y) / squares_without_noise if squares_without_noise else float("nan")


def estimate_spin_centre_offset_m(
    force_x: Floats, force_y: Floats, yaw_rate: Floats, yaw_acceleration: Floats, is_used: Bools
) -> float:
    """Distance from the origin to the centre of rotation in spins, in m; NaN if unknown.

    The specific force of an origin at r from the centre is ω̇ × r - ω² r; a constant part (a slope,
    a bias) is fitted as well.
    """
    zero, one = np.zeros(yaw_rate.size), np.ones(yaw_rate.size)
    row_x = np.column_stack([-(yaw_rate**2), -yaw_acceleration, one, zero])
    row_y = np.column_stack([yaw_acceleration, -(yaw_rate**2), zero, one])
    is_used = is_used & np.isfinite(row_x).all(axis=1) & np.isfinite(force_x) & np.isfinite(force_y)
    if is_used.sum() < LIMITS.samples_per_parameter * row_x.shape[1]:
        return float("nan")
    rows = np.concatenate([row_x[is_used], row_y[is_used]])
    r = np.linalg.lstsq(rows, np.concatenate([force_x[is_used], force_y[is_used]]), rcond=None)[0]
    return float(np.hypot(r[0], r[1]))
