"""Swing: an accelerometer above the body's pitch axis also measures how the body swings.

A body on springs pitches by s for each m/s², like a mass on a spring and a damper:

    y'' + 2 ζ ω y' + ω² y = ω² a        the pitch is s · y

An accelerometer at the height h above the axis reads h s · y'' besides the acceleration and the
gravity g s · y: the body swings at every start and stop, by several percent of the acceleration,
and more with a heavier load. With y = a - 2 ζ/ω y' - y''/ω² the sum is a squat g s · a, a delay,
and a swing κ · y'' with κ = h s - g s/ω², which the wheels determine:

    v = ∫ (1 + gain) a dt + slip · |u| F - delay · a - κ · y'

in differences over a quarter of a second, in which grades, tilt and integrated noise are small.
The rate y' and the integral share the accelerometer's noise; the force, with independent noise, is
the instrument for y' (instrumental variables; Wooldridge, Econometric Analysis of Cross Section
and Panel Data, ch. 5). Frequency and damping are those with the smallest residual.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Self

import numpy as np

from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.body_limits import LIMITS
from analysis.weighing.fitted_stretches import find_stretch_spans
from analysis.weighing.motion_samples import Floats, Ints, MotionSamples
from analysis.weighing.pitch_squat import estimate_by_instrumental_variables_with_covariance
from analysis.weighing.stretch_means import EVERY, MEAN, compute_overlapping_means
from estimators.interpreted import compiled_unless_short_log
from estimators.numerics.in_order import sum_in_order


@dataclass(frozen=True, slots=True)
class BodySwing:
    """Effect of a swinging body on its accelerometer.

    Attributes:
        lever_s2: κ, reading per m/s⁴ of y'' with the mean load; 0 for no swing.
        u_s2: standard uncertainty of κ.
        frequency_hz: natural frequency of the springs.
        damping_1: damping ratio.
    """

    lever_s2: float = 0.0
    u_s2: float = 0.0
    frequency_hz: float = 1.0
    damping_1: float = 1.0

    def copy_with_swing_of_squat(self, squat_1: float) -> "BodySwing":
        """Copy for a reading that still includes the gravity component due to pitch.

        Args:
            squat_1: squat whose gravity component the pitch channel removed from this reading.
        """
        return replace(self, lever_s2=self.lever_s2 - squat_1 / self.omega_1_s**2)

    @property
    def omega_1_s(self) -> float:
        """Angular frequency ω, in rad/s."""
        return 2.0 * np.pi * self.frequency_hz

    @property
    def is_stable(self) -> bool:
        """Whether the acceleration can be computed from a reading with this swing."""
        return self.lever_s2 * self.omega_1_s**2 > -LIMITS.lever_max_below_1

    def compute_swing_acceleration_m_s2(
        self, measured_acceleration: Floats, rate_hz: float
    ) -> Floats:
        """κ · y'' computed from an accelerometer on the body, (n,) in m/s²."""
        return self._filter_by_body_dynamics(
            measured_acceleration, rate_hz, (self.lever_s2, 0.0, 0.0)
        )

    def compute_rate_of_body_filtered_acceleration_m_s3(
        self, measured_acceleration: Floats, rate_hz: float
    ) -> Floats:
        """Rate y' of the pitch variable from an accelerometer on the body, (n,) in m/s³."""
        return self._filter_by_body_dynamics(measured_acceleration, rate_hz, (0.0, 1.0, 0.0))

    def _filter_by_body_dynamics(
        self, signal: Floats, rate_hz: float, numerator: tuple[float, ...]
    ) -> Floats:
        from scipy.signal import bilinear, lfilter, lfilter_zi

        omega_1_s = self.omega_1_s
        # the measured acceleration contains the swing
        swings = 1.0 + self.lever_s2 * omega_1_s**2
        below = (swings, 2.0 * self.damping_1 * omega_1_s, omega_1_s**2)
        b, a = bilinear(omega_1_s**2 * np.array(numerator), below, rate_hz)
        return lfilter(b, a, signal, zi=lfilter_zi(b, a) * signal[0])[0]


def estimate_body_swing(
    measured_acceleration: Floats, motion: MotionSamples, springs: BodySwing
) -> BodySwing | None:
    """Estimate the swing from wheels and accelerometer; None if there is none.

    Args:
        measured_acceleration: (n,) accelerometer in m/s², with or without gravity by the pitch.
        motion: samples, with the speed as measured.
        springs: springs of the body, and the swing assumed in the reading at first.
    """
    compared = _WheelComparison.from_motion(measured_acceleration, motion)
    solved = None if compared is None else compared.estimate_swing_with_springs(springs)
    if solved is None:
        return None
    found = solved[0]
    least_s2 = max(LIMITS.lever_min_s2, LIMITS.pitch_squat_min_std * found.u_s2)
    if not (abs(found.lever_s2) > least_s2 and found.is_stable):
        return None
    return replace(found, u_s2=float(np.hypot(found.u_s2, LIMITS.lever_shape_u * found.lever_s2)))


def fit_body_spring_rates(measured_acceleration: Floats, motion: MotionSamples) -> BodySwing | None:
    """Find the springs with the smallest residual between wheels and accelerometer.

    Args:
        measured_acceleration: (n,) accelerometer in m/s², with or without gravity by the pitch.
        motion: samples, with the speed as measured.

    Returns:
        A body with these springs and a first estimate of its swing; None if the grid is too slow or
        there are too few stretches.
    """
    from scipy.optimize import Bounds, minimize

    compared = _WheelComparison.from_motion(measured_acceleration, motion)
    if compared is None:
        return None

    tried = [
        compared.estimate_swing_with_springs(BodySwing(frequency_hz=hz, damping_1=damping_1))
        for hz, damping_1 in product(LIMITS.lever_frequencies_hz, LIMITS.lever_dampings_1)
    ]
    known = [each for each in tried if each is not None]
    if not known:
        return None
    first, _ = min(known, key=lambda each: each[1])

    def make_swing_from_logs(logs: Floats) -> BodySwing:
        hz, damping_1 = np.exp(logs).tolist()
        return replace(first, frequency_hz=hz, damping_1=damping_1)

    def compute_misfit_of_swing(logs: Floats) -> float:
        found = compared.estimate_swing_with_springs(make_swing_from_logs(logs))
        return np.inf if found is None else found[1]

    start = np.log([first.frequency_hz, first.damping_1])
    corners = start + LIMITS.lever_step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    low, high = np.log(
        [(tried[0], tried[-1]) for tried in (LIMITS.lever_frequencies_hz, LIMITS.lever_dampings_1)]
    ).T
    best = minimize(
        compute_misfit_of_swing,
        start,
        method="Nelder-Mead",
        bounds=Bounds(low, high),
        options={"initial_simplex": corners, "xatol": LIMITS.lever_tolerance, "fatol": np.inf},  # pyright: ignore[reportArgumentType] the stubs know no simplex
    )
    return make_swing_from_logs(best.x)


@dataclass(frozen=True)
class _WheelComparison:
    """Differences of wheels and accelerometer that do not depend on the springs.

    Attributes:
        motion: the samples.
        spans: (stretches, 2) first and end sample of each stretch that is long enough.
        lag: number of means from one term of a difference to the other.
        shared: (means, 4) differences of accelerometer integral, slip, delay and response, for each
            stretch.
    """

    motion: MotionSamples
    spans: Ints
    lag: int
    shared: list[Floats]

    @classmethod
    def from_motion(cls, measured_acceleration: Floats, motion: MotionSamples) -> Self | None:
        """Prepare the stretches that are long enough; None if there are too few."""
        if motion.rate_hz < LIMITS.lever_min_rate_hz:
            return None
        lag = max(count_rows_in_duration(LIMITS.lever_lag_s, motion.rate_hz) // EVERY, 1)
        shortest = MEAN + EVERY * max(2 * lag, LIMITS.lever_min_rows)
        bounds = find_stretch_spans(motion.stretch_of_sample)
        spans = bounds[np.diff(bounds)[:, 0] >= shortest]
        if len(spans) < LIMITS.squat_min_stretches:
            return None
        gained = np.zeros(measured_acceleration.size)
        for first, end in spans.tolist():
            a = measured_acceleration[first:end]
            gained[first:end] = (np.cumsum(a) - a / 2.0) / motion.rate_hz
        slipping = np.abs(motion.speed) * motion.force
        columns = (gained, slipping, -measured_acceleration, motion.speed - gained)
        return cls(
            motion, spans, lag, compute_lagged_differences_of_stretch_means(columns, spans, lag)
        )

    def estimate_swing_with_springs(self, springs: BodySwing) -> tuple[BodySwing, float] | None:
        """Body with these springs and the swing fitted for them, and the mean square residual."""
        motion = self.motion
        assert motion.specific_force is not None
        swings = springs.compute_rate_of_body_filtered_acceleration_m_s3(
            motion.specific_force, motion.rate_hz
        )
        by_force = springs.compute_rate_of_body_filtered_acceleration_m_s3(
            motion.force, motion.rate_hz
        )
        own = compute_lagged_differences_of_stretch_means(
            (-swings, -by_force), self.spans, self.lag
        )
        parts = [np.column_stack(both) for both in zip(self.shared, own, strict=True)]
        scale = np.sqrt(np.mean([(rows**2).mean(axis=0) for rows in parts], axis=0))
        if not (scale > 0.0).all():
            return None
        parts = [rows / scale for rows in parts]
        columns, instruments, response = [0, 1, 2, 4], [0, 1, 2, 5], 3
        solved = estimate_by_instrumental_variables_with_covariance(
            np.array([rows[:, instruments].T @ rows[:, columns] for rows in parts]),
            np.array([rows[:, instruments].T @ rows[:, response] for rows in parts]),
        )
        if solved is None:
            return None
        theta, covariance = solved
        residuals = (rows[:, response] - rows[:, columns] @ theta for rows in parts)
        left = sum(float(residual @ residual) for residual in residuals)
        unit_s2 = float(scale[response] / scale[4])
        lever_s2, std_s2 = float(theta[3]) * unit_s2, float(np.sqrt(covariance[3, 3])) * unit_s2
        found = replace(springs, lever_s2=lever_s2, u_s2=std_s2)
        return found, left * float(scale[response]) ** 2


def compute_lagged_differences_of_stretch_means(
    columns: tuple[Floats, ...], spans: Ints, lag_in_means: int
) -> list[Floats]:
    """Centred differences of each column's means, (means - lag, columns) for each stretch."""
    ends = np.cumsum((spans[:, 1] - spans[:, 0] - MEAN) // EVERY + 1 - lag_in_means)[:-1]
    rows = np.column_stack(
        [_compute_lagged_differences_of_column(x, spans, lag_in_means) for x in columns]
    )
    return np.split(rows, ends)


@compiled_unless_short_log
def _compute_lagged_differences_of_column(column: Floats, spans: Ints, lag_in_means: int) -> Floats:
    """Centred differences of a column's means, the stretches concatenated."""
    counts = (spans[:, 1] - spans[:, 0] - MEAN) // EVERY + 1 - lag_in_means
    out, row = np.empty(counts.sum()), 0
    for number in range(len(spans)):
        means = compute_overlapping_means(column[spans[number, 0] : spans[number, 1]])
        differences = means[lag_in_means:] - means[:-lag_in_means]
        out[row : row + counts[number]] = differences - sum_in_order(differences) / counts[number]
        row += counts[number]
    return out


def subtract_swing_from_accelerometer(motion: MotionSamples, swing: BodySwing) -> MotionSamples:
    """Copy of the motion with the swing subtracted from its accelerometer."""
    assert motion.specific_force is not None
    swing_m_s2 = swing.compute_swing_acceleration_m_s2(motion.specific_force, motion.rate_hz)
    level = motion.without_gravity
    return replace(
        motion,
        specific_force=motion.specific_force - swing_m_s2,
        without_gravity=None if level is None else level - swing_m_s2,
    )


#: Swing of a body that does not swing, or whose swing is unknown.
NO_SWING: Final = BodySwing()
