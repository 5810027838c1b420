"""Squat from the measured pitch: gravity that follows the acceleration.

The pitch is the sum of the ground's grade, which depends on the place, and a squat, which depends
on the acceleration and, through springs and the pitch's own filter, on its rate. Over the first
metres of a start the grade is modelled as a cubic of the distance. The acceleration contains the
noise of the pitch that was subtracted from it, so the force, with independent noise, is the
instrument (instrumental variables; Wooldridge, Econometric Analysis of Cross Section and Panel
Data, ch. 5).
"""

from dataclasses import dataclass

import numpy as np

from analysis.weighing.body_limits import LIMITS
from analysis.weighing.motion_samples import Floats, Ints, MotionSamples
from analysis.weighing.stretch_means import EVERY, MEAN, compute_overlapping_means
from estimators.numerics.fit_loss import list_rows_by_group


@dataclass(frozen=True, slots=True)
class PitchProducts:
    """Products of force and force rate with the pitch's gravity and the motion, by stretch.

    Attributes:
        first: (stretches,) index of the first sample.
        response: (stretches, 2) products with the pitch's gravity.
        columns: (stretches, 2, 2) products with the acceleration and its rate.
    """

    first: Ints
    response: Floats
    columns: Floats


def sum_products_of_pitch_gravity_and_speed(
    gravity: Floats, motion: MotionSamples
) -> PitchProducts:
    """Compute the products by stretch, after removing a cubic of the distance from each signal.

    Args:
        gravity: (n,) gravity along x by the pitch, in m/s².
        motion: the samples, with a pitch.
    """
    assert motion.without_gravity is not None
    first: list[int] = []
    products: list[Floats] = []
    channels = (motion.without_gravity, motion.force / motion.force_95_percentile_newtons, gravity)
    for part in list_rows_by_group(motion.stretch_of_sample):
        travelled_m = np.cumsum(np.abs(motion.speed[part])) / motion.rate_hz
        near = part[travelled_m < LIMITS.grade_reach_m]
        if near.size < MEAN + EVERY * (LIMITS.pitch_min_rows + 2 * LIMITS.pitch_rate_means):
            continue
        a, force, pitch = (compute_overlapping_means(channel[near]) for channel in channels)
        grade = np.vander(
            drop_end_means_without_rate(compute_overlapping_means(travelled_m[: near.size]))
            / LIMITS.grade_reach_m,
            LIMITS.grade_degree + 1,
        )
        rows = np.column_stack(
            [
                drop_end_means_without_rate(force),
                _differentiate_means(force),
                drop_end_means_without_rate(a),
                _differentiate_means(a),
                drop_end_means_without_rate(pitch),
            ]
        )
        rows -= grade @ np.linalg.lstsq(grade, rows, rcond=None)[0]
        first.append(int(near[0]))
        products.append(rows[:, :2].T @ rows[:, 2:])
    both = np.array(products).reshape(-1, 2, 3)
    return PitchProducts(np.array(first, np.int64), both[:, :, 2], both[:, :, :2])


def drop_end_means_without_rate(means: Floats) -> Floats:
    """Drop the means at either end, for which no rate can be computed."""
    return means[LIMITS.pitch_rate_means : -LIMITS.pitch_rate_means]


def _differentiate_means(means: Floats) -> Floats:
    """Differences of means that are a fixed number of means apart, in proportion to the rate."""
    return means[2 * LIMITS.pitch_rate_means :] - means[: -2 * LIMITS.pitch_rate_means]


def estimate_by_instrumental_variables_with_covariance(
    columns: Floats, response: Floats
) -> tuple[Floats, Floats] | None:
    """Instrumental-variables estimate with cluster-robust covariance.

    Args:
        columns: (clusters, p, p) instruments times columns.
        response: (clusters, p) instruments times the response.

    Returns:
        (p,) coefficients and (p, p) their covariance; None if the instruments are too weak.
    """
    count, p = response.shape
    total = columns.sum(axis=0)
    if count <= p or np.linalg.matrix_rank(total) < p:
        return None
    bread = np.linalg.inv(total)
    theta = bread @ response.sum(axis=0)
    scores = response - columns @ theta
    return theta, bread @ scores.T @ scores @ bread.T * (count / (count - p))


def estimate_squat_fraction_and_u(
    pitch_gravity_m_s2: Floats,
    motion: MotionSamples,
    excess_by_wheels_and_std: tuple[float, float] | None = None,
) -> tuple[float, float] | None:
    """Fraction of the acceleration that appears as gravity through the pitch.

    Args:
        pitch_gravity_m_s2: (n,) gravity along x by the pitch.
        motion: the samples, with a pitch.
        excess_by_wheels_and_std: fraction by which the accelerometer exceeds the wheels before
            gravity by the pitch is removed, and its standard deviation; None if it does not.

    Returns:
        The fraction, and the standard uncertainty of its effect on the accelerometer; None without
        a squat.
    """
    found = sum_products_of_pitch_gravity_and_speed(pitch_gravity_m_s2, motion)
    solved = estimate_by_instrumental_variables_with_covariance(found.columns, found.response)
    if solved is None:
        return None
    share, std = float(solved[0][0]), float(np.sqrt(solved[1][0, 0]))
    few = found.first.size < LIMITS.pitch_min_stretches
    if few or not _is_squat(share, std):
        # a few starts do not distinguish a squat from hills, unless the wheels show the same
        shows = share > LIMITS.shared_squat_min_std * std
        if excess_by_wheels_and_std is None or not (
            shows and _do_estimates_agree(excess_by_wheels_and_std, (share, std))
        ):
            return None
        weights = np.array([std, excess_by_wheels_and_std[1]]) ** -2.0
        share = float(weights @ [share, excess_by_wheels_and_std[0]] / weights.sum())
        std = float(weights.sum() ** -0.5)
        if not _is_squat(share, std):
            return None
    return share, float(np.hypot(std, LIMITS.spring_swing_u * share))


def _is_squat(share: float, std: float) -> bool:
    return share > max(LIMITS.min_pitch_squat_fraction, LIMITS.pitch_squat_min_std * std)


def _do_estimates_agree(first: tuple[float, float], second: tuple[float, float]) -> bool:
    """Whether two estimates differ by less than two standard deviations of their difference."""
    return abs(first[0] - second[0]) < 2.0 * float(np.hypot(first[1], second[1]))
