"""Squat: the accelerometer's gain differs between loads, since the body pitches with its load.

On its springs the body pitches in proportion to load and acceleration, and through that pitch the
accelerometer measures gravity. In the force equation this looks like a different load; the wheels
distinguish the two:

    v = ∫ (1 + g + h · load) a dt + slip · u F - delay · a + a constant and a slope a stretch

with the load relative to a reference. The slopes are tilt, bias and grade. Their scatter about a
common slope is estimated from the log: on even ground a few starts determine h, on hills they do
not. A grade that recurs along the route, driven one way loaded and the other way empty, looks like
a squat that grows with the load, so it has terms of its own. A measured pitch shows directly how
the body pitches with the acceleration.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.weighing.body_limits import LIMITS
from analysis.weighing.fit_columns import RelativeLoads
from analysis.weighing.fitted_stretches import find_stretch_spans
from analysis.weighing.haul_route import HaulRoute
from analysis.weighing.motion_samples import (
    Floats,
    MotionSamples,
    compute_ground_to_wheel_speed_ratio,
)
from analysis.weighing.pitch_squat import (
    estimate_by_instrumental_variables_with_covariance,
    sum_products_of_pitch_gravity_and_speed,
)
from analysis.weighing.uneven_ground import compute_relative_random_walk_std
from analysis.weighing.wheel_kinematics import WheelKinematics
from estimators.numerics.autocorrelation import compute_student_to_normal_ratio

#: Number of columns before those of the grade: gain by load, gain, slip, delay.
_OWN_COLUMNS: Final = 4


@dataclass(frozen=True)
class LoadSquat:
    """Change of the accelerometer's gain with the load.

    Attributes:
        gain: change of gain for a load of the reference mass: 0 or the wheels' estimate, whichever
            is more probable.
        std: its standard deviation, including the choice between the two (law of total variance).
        relative_load: (masses,) load of each state over the reference mass.
    """

    gain: float
    std: float
    relative_load: Floats

    @property
    def mass_overestimation_factors(self) -> Floats:
        """(masses,) factor by which each mass is overestimated."""
        return 1.0 + self.gain * self.relative_load

    def compute_mass_sum_u_kg(self, coefficients: Floats, masses_kg: Floats) -> float:
        """Standard uncertainty of a sum of masses, in kg.

        Args:
            coefficients: (masses,) weight of each mass in the sum.
            masses_kg: (masses,) masses.
        """
        return abs(float(coefficients @ (masses_kg * self.relative_load))) * self.std


def estimate_load_squat(
    motion: MotionSamples,
    wheels: WheelKinematics,
    loads: RelativeLoads,
    relative_load: Floats,
    prior_std: float,
    route: HaulRoute | None = None,
) -> LoadSquat | None:
    """Estimate the change of gain by comparing wheels and accelerometer load by load.

    Args:
        motion: samples, with the speed as measured.
        wheels: delay and slip of the wheels.
        loads: relative load of each manoeuvre.
        relative_load: (masses,) relative load of each state.
        prior_std: prior standard deviation of the change for a load of the reference mass.
        route: route between loading and dumping, along which the grade changes; None if unknown.

    Returns:
        The change; None if the motion does not determine it.
    """
    if wheels.pitch_shows_squat:
        gain, variance = estimate_gain_change_and_variance_from_squat(
            wheels.squat[0], estimate_gain_change_and_variance_from_pitch(motion, loads)
        )
        return LoadSquat(gain, float(np.sqrt(variance)), relative_load)
    widths = np.empty(0) if route is None else compute_grade_prior_stds_m_s2(route)
    found = estimate_accelerometer_gain_change_by_load(
        make_centred_stretches(motion, wheels, loads, route), widths
    )
    if wheels.squat[0] > 0.0:
        seen = None if found is None else (found.gain, found.variance)
        gain, variance = estimate_gain_change_and_variance_from_squat(wheels.squat[0], seen)
        return LoadSquat(gain, float(np.sqrt(variance)), relative_load)
    if found is None:
        return None
    value, variance = found.gain, found.variance
    before = LIMITS.squat_prior_probability
    if wheels.is_gain_significant and wheels.gain[0] < 0.0:
        # a body that squats when empty squats more with a load
        before = LIMITS.squat_by_load_prior_probability
    # a squat that the pitch hides may change with the load by up to its own size
    hidden_1 = 0.0 if motion.without_gravity is None else max(-wheels.gain[0], 0.0)
    least_std = hidden_1 / np.sqrt(3.0)
    if could_grades_explain_gain_change(found, wheels):
        return LoadSquat(0.0, max(float(np.sqrt(before)) * prior_std, least_std), relative_load)
    # normal densities of what was measured, with a change and without
    wide = variance + prior_std**2
    log_odds = 0.5 * (np.log(variance / wide) + value**2 * (1.0 / variance - 1.0 / wide))
    odds = before / (1.0 - before) * float(np.exp(min(log_odds, LIMITS.squat_certain_log_odds)))
    probability = odds / (1.0 + odds)
    value *= prior_std**2 / wide
    variance *= prior_std**2 / wide
    squats = probability > 0.5
    other = 1.0 - probability if squats else probability
    own = variance if squats else probability * variance
    std = max(float(np.sqrt(own + other * value**2)), least_std)
    return LoadSquat(value if squats else 0.0, std, relative_load)


def estimate_gain_change_and_variance_from_squat(
    load_transfer_fraction: float, pitch_change: tuple[float, float] | None
) -> tuple[float, float]:
    """Change of the accelerometer's gain with the load, and its variance, from the squat.

    Linear springs deflect in proportion to the mass on them.

    Args:
        load_transfer_fraction: squat at the reference mass, as a fraction of the acceleration.
        pitch_change: measured change of gain, and its variance; None if unknown.
    """
    mean, variance = (
        -load_transfer_fraction,
        (LIMITS.squat_growth_std * load_transfer_fraction) ** 2,
    )
    if pitch_change is None:
        return mean, variance
    shown, shown_variance = pitch_change
    both = variance + shown_variance
    return (mean * shown_variance + shown * variance) / both, variance * shown_variance / both


_Stretch = tuple[Floats, Floats, Floats, float]


def make_centred_stretches(
    motion: MotionSamples,
    wheels: WheelKinematics,
    loads: RelativeLoads,
    route: HaulRoute | None,
) -> list[_Stretch]:
    """Make the rows of the comparison for each stretch, with the means removed.

    A stretch is a tuple of columns (means, columns), response (means,), time (means,) in s and
    relative load.
    The first four columns are gain by load, gain, slip and delay; those of the grade follow: its
    level and its change over each part of the route.
    """
    assert motion.specific_force is not None
    # a squat that grows with the load is itself a reason for wheels and accelerometer to disagree
    known = wheels.is_consistent
    delay_s, slip_1_N = (wheels.delay_s[0], wheels.slip_1_N[0]) if known else (0.0, 0.0)
    in_time = motion.advance_speed(delay_s)
    ground = in_time.speed * compute_ground_to_wheel_speed_ratio(
        in_time.speed, motion.force, slip_1_N
    )
    relative = loads.look_up_relative_loads(motion.manoeuvre_of_sample)
    along = route and (
        route.compute_relative_distances_to_dump(motion),
        route.compute_headings_from_dump(motion),
    )
    found: list[_Stretch] = []
    for start, end in find_stretch_spans(motion.stretch_of_sample).tolist():
        means = (end - start) // LIMITS.squat_mean_samples
        if means < LIMITS.squat_min_means:
            continue
        part = slice(start, start + means * LIMITS.squat_mean_samples)
        a = motion.specific_force[part]
        gained = (np.cumsum(a) - a / 2.0) / motion.rate_hz
        load = float(relative[start])
        columns = np.column_stack(
            # the wheel speed, not the integrated accelerometer: a squat does not scale the gravity
            # on a slope
            [ground[part] * load, ground[part], np.abs(ground[part]) * motion.force[part], -a]
        )
        if along:
            place, heading = (each[part] for each in along)
            columns = np.hstack(
                [columns, compute_cumulative_grade_columns(place, heading) / motion.rate_hz]
            )
        y = ground[part] - gained
        both = (
            np.column_stack([columns, y]).reshape(means, LIMITS.squat_mean_samples, -1).mean(axis=1)
        )
        both = both - both.mean(axis=0)
        time = np.linspace(-0.5, 0.5, means) * means * LIMITS.squat_mean_samples / motion.rate_hz
        found.append((both[:, :-1], both[:, -1], time, load))
    return found


def compute_cumulative_grade_columns(route_position_1: Floats, heading_sign: Floats) -> Floats:
    """Cumulative sums of the grade's level and of its change over each part of the route.

    Args:
        route_position_1: (n,) distance from the dump divided by the route's length.
        heading_sign: (n,) 1 with the front away from the dump, -1 towards it.

    Returns:
        (n, 1 + parts) sums up to the middle of each sample interval.
    """
    risen = np.clip(
        route_position_1[:, None] * LIMITS.squat_grade_parts - np.arange(LIMITS.squat_grade_parts),
        0.0,
        1.0,
    )
    grade = heading_sign[:, None] * np.insert(risen, 0, 1.0, axis=1)
    return np.cumsum(grade, axis=0) - grade / 2.0


def estimate_gain_change_and_variance_from_pitch(
    motion: MotionSamples, loads: RelativeLoads
) -> tuple[float, float] | None:
    """Change of the accelerometer's gain for the reference load from the pitch, and its variance.

    Returns:
        The change and its variance; None if the motion does not determine it.
    """
    assert motion.specific_force is not None
    assert motion.without_gravity is not None
    gravity = motion.specific_force - motion.without_gravity
    squats = sum_products_of_pitch_gravity_and_speed(gravity, motion)
    relative = loads.look_up_relative_loads(motion.manoeuvre_of_sample)[squats.first]
    if relative.size < LIMITS.squat_min_stretches or np.ptp(relative) == 0.0:
        return None
    # besides the responses to acceleration and rate, the one that grows with the load
    times = np.column_stack([relative, np.ones((relative.size, 2))])
    columns = squats.columns[:, [0, 0, 1], :][:, :, [0, 0, 1]]
    columns = times[:, :, None] * columns * times[:, None, :]
    solved = estimate_by_instrumental_variables_with_covariance(
        columns, times * squats.response[:, [0, 0, 1]]
    )
    if solved is None:
        return None
    theta, covariance = solved
    # the pitch adds to the accelerometer's reading and so reduces the mass
    variance = (
        float(covariance[0, 0]) * compute_student_to_normal_ratio(relative.size - theta.size) ** 2
    )
    return -float(theta[0]), variance


@dataclass(frozen=True, slots=True)
class GainChangeByLoad:
    """Change of gain with the load, estimated from the wheels.

    Attributes:
        gain: change of the gain for a load of the reference mass.
        variance: cluster-robust variance of the change.
        residual_ratio: r.m.s. difference of wheels and accelerometer with the change, over that
            without it.
    """

    gain: float
    variance: float
    residual_ratio: float


def could_grades_explain_gain_change(
    gain_change: GainChangeByLoad, wheels: WheelKinematics
) -> bool:
    """Whether grades that recur with the load explain the change of gain.

    Grades change the gain in either direction and leave most of the residual; springs can only make
    the accelerometer read more, and explain the residual.
    """
    if abs(gain_change.gain) < LIMITS.squat_by_load_min_std * float(np.sqrt(gain_change.variance)):
        return False
    explained = wheels.is_consistent or gain_change.residual_ratio < LIMITS.squat_residual_ratio
    return gain_change.gain > 0.0 or not explained


def compute_grade_prior_stds_m_s2(route: HaulRoute) -> Floats:
    """Prior standard deviations of the grade's columns, as gravity along the slope in m/s²."""
    change = LIMITS.grade_change_m_s2 * compute_relative_random_walk_std(
        route.length_m / LIMITS.squat_grade_parts
    )
    return np.append(LIMITS.grade_m_s2, np.full(LIMITS.squat_grade_parts, change))


def estimate_accelerometer_gain_change_by_load(
    stretches: list[_Stretch], grade_prior_stds_m_s2: Floats
) -> GainChangeByLoad | None:
    """Change of gain with the load from the wheels; None if undetermined.

    Args:
        stretches: columns of each stretch, by `make_centred_stretches`.
        grade_prior_stds_m_s2: (columns,) prior standard deviations of the grade's columns, in m/s².
    """
    if len(stretches) < LIMITS.squat_min_stretches or len({load for *_, load in stretches}) < 2:
        return None
    free = [
        whiten_rows_with_random_slope_over_time(columns, y, time, np.inf)
        for columns, y, time, _ in stretches
    ]
    # with a slope for each stretch: the scatter of the slopes beyond their noise
    X, y = (np.concatenate([each[i] for each in free]) for i in (0, 1))
    own = X[:, :_OWN_COLUMNS]
    degrees_of_freedom = max(y.size - _OWN_COLUMNS - 2 * len(stretches), 1)
    pilot = float(((y - own @ np.linalg.lstsq(own, y)[0]) ** 2).sum()) / degrees_of_freedom
    prior = np.zeros((grade_prior_stds_m_s2.size, X.shape[1]))
    np.fill_diagonal(prior[:, _OWN_COLUMNS:], np.sqrt(pilot) / grade_prior_stds_m_s2)
    rows_X, rows_y = (
        np.concatenate([X, prior]),
        np.concatenate([y, np.zeros(grade_prior_stds_m_s2.size)]),
    )
    beta, _, rank, _ = np.linalg.lstsq(rows_X, rows_y)
    if rank < X.shape[1]:
        return None
    variance = float(((y - X @ beta) ** 2).sum()) / degrees_of_freedom
    if not variance > 0.0:
        return None
    bare = y - X[:, 1:] @ np.linalg.lstsq(rows_X[:, 1:], rows_y)[0]
    left = float(np.linalg.norm(y - X @ beta) / np.linalg.norm(bare))
    slopes = np.array([time @ (y - X @ beta) / (time @ time) for X, y, time, _ in stretches])
    noise = np.array([variance / (time @ time) for *_, time, _ in stretches])
    count = slopes.size
    scatter = max(float(np.var(slopes, ddof=1) - noise.mean()), 0.0)
    scatter *= compute_student_to_normal_ratio(count - 1) ** 2
    part = [
        whiten_rows_with_random_slope_over_time(X, y, time, scatter / variance)
        for X, y, time, _ in stretches
    ]
    X, y = (np.concatenate([each[i] for each in part]) for i in (0, 1))
    shared = np.concatenate([each[2] for each in part])
    X = np.column_stack([X, shared])
    prior = np.column_stack([prior, np.zeros(grade_prior_stds_m_s2.size)])
    scale = np.sqrt((X**2).mean(axis=0) + (prior**2).sum(axis=0))
    if not (scale > 0.0).all():
        return None
    X, prior = X / scale, prior / scale
    prior_information = prior.T @ prior
    bread = np.linalg.pinv(X.T @ X + prior_information)
    theta = bread @ X.T @ y
    residual = y - X @ theta
    ends_at = np.cumsum([each[1].size for each in part])[:-1]
    parts = zip(np.split(X, ends_at), np.split(residual, ends_at), strict=True)
    scores = np.stack([own.T @ left for own, left in parts])
    degrees_of_freedom = max(count - _OWN_COLUMNS - 1, 1)
    meat = scores.T @ scores * count / degrees_of_freedom + prior_information * variance
    # at least the variance by white noise, since stretches may agree by chance
    found = max(float((bread @ meat @ bread)[0, 0]), float(bread[0, 0]) * variance)
    found *= compute_student_to_normal_ratio(degrees_of_freedom) ** 2
    return GainChangeByLoad(float(theta[0] / scale[0]), found / float(scale[0]) ** 2, left)


def whiten_rows_with_random_slope_over_time(
    columns: Floats, y: Floats, time_s: Floats, variance_ratio: float
) -> tuple[Floats, Floats, Floats]:
    """Whiten a stretch whose random slope has `variance_ratio` times the variance of a row.

    An infinite ratio projects the slope out.
    """
    square = float(time_s @ time_s)
    kept = 0.0 if np.isinf(variance_ratio) else 1.0 / np.sqrt(1.0 + variance_ratio * square)

    def whiten_along_time(x: Floats) -> Floats:
        return x - (1.0 - kept) * np.multiply.outer(time_s, time_s @ x / square)

    return whiten_along_time(columns), whiten_along_time(y), whiten_along_time(time_s)
