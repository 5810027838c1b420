"""Wheels against accelerometer: gain, slip and delay of the speed, from the motion alone.

    v = ∫ (1 + gain) a dt + slip · |u| (F - F₀) - delay · a + a constant and a slope a manoeuvre

with the ground speed u. The constant is the speed at which a manoeuvre begins, and the slope
absorbs tilt, bias and grade. Slip is κ = F / C (Pacejka, Tire and Vehicle Dynamics, chapter 1), so
its coefficient is 1 / C; an offset F₀ of the force looks like a gain if all driving is one way.
"""

from dataclasses import replace

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.body_limits import LIMITS as BODY_LIMITS
from analysis.weighing.body_swing import (
    BodySwing,
    estimate_body_swing,
    fit_body_spring_rates,
    subtract_swing_from_accelerometer,
)
from analysis.weighing.fitted_stretches import find_stretch_spans
from analysis.weighing.motion_samples import (
    ColumnNoiseModel,
    Floats,
    Ints,
    MotionSamples,
    compute_ground_to_wheel_speed_ratio,
)
from analysis.weighing.nuisances import compute_constant_force_prior_std_of_motion_newtons
from analysis.weighing.pitch_squat import estimate_squat_fraction_and_u
from analysis.weighing.stretch_means import (
    EVERY,
    MEAN,
    compute_overlapping_means,
    make_constant_and_slope_of_each_stretch,
    subtract_fitted_line,
)
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import (
    TERMS,
    ComparisonRows,
    WheelKinematics,
    compute_parameter_std_bounds_by_noise,
    estimate_gain_that_noise_mimics,
)
from estimators.interpreted import compiled_unless_short_log
from estimators.joint import prior_fit
from estimators.joint.posterior_fit import PosteriorFit
from estimators.joint.prior_fit import Grouping
from estimators.numerics.autocorrelation import compute_autocovariance_loss
from estimators.numerics.group_sums import NoiseMoments
from estimators.numerics.in_order import sum_in_order


def compare_wheels_with_accelerometer(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    earlier_kinematics: WheelKinematics | None = None,
    springs: BodySwing | None = None,
) -> WheelKinematics | None:
    """Compare wheels with the accelerometer, corrected for squat and swing of the body.

    Args:
        motion: the samples.
        noise: noise of acceleration, speed and force.
        priors: priors of slip, gain, delay and offset.
        earlier_kinematics: comparison of a similar motion, as the starting point.
        springs: springs of the body, if known.

    Returns:
        The comparison; None without an accelerometer or without a long enough stretch.
    """
    found = compare_wheels_and_choose_gravity_removal(motion, noise, priors, earlier_kinematics)
    if found is None or not found.squat[0] > 0.0 or motion.specific_force is None:
        return found
    level = motion.without_gravity
    measured = motion.specific_force if level is None else level
    springs = springs or fit_body_spring_rates(measured, motion)
    swing = None if springs is None else estimate_body_swing(measured, motion, springs)
    if swing is None:
        return replace(found, springs=springs)
    still = compare_wheels_and_choose_gravity_removal(
        subtract_swing_from_accelerometer(motion, swing), noise, priors, earlier_kinematics
    )
    if still is None:
        return None
    swing = swing if level is None else swing.copy_with_swing_of_squat(still.squat[0])
    return replace(still, swing=swing, springs=springs)


def compare_wheels_and_choose_gravity_removal(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    earlier_kinematics: WheelKinematics | None,
) -> WheelKinematics | None:
    """Compare wheels and accelerometer, and choose whether to subtract gravity from its readings.

    Gravity, computed from the measured pitch, is subtracted on hills that change it within a
    manoeuvre. On even ground it is not, so that a squat, which also pitches the body, appears as a
    gain.
    """
    if motion.specific_force is None:
        return None
    told = (
        None
        if earlier_kinematics is None or not earlier_kinematics.can_start_next_comparison
        else earlier_kinematics.estimates_of_this_log or earlier_kinematics
    )
    found = _fit_wheel_comparison(motion.specific_force, motion, noise, priors, told)
    if found is None:
        return None
    if motion.without_gravity is None:
        return compare_wheels_after_squat_correction(
            found, motion.specific_force, motion, noise, priors, told
        )
    level = _fit_wheel_comparison(motion.without_gravity, motion, noise, priors, told)
    if level is None:
        return found
    pitch_explains_gain = found.is_gain_significant and not level.is_gain_significant
    excess = (-found.gain[0], found.gain[1]) if pitch_explains_gain else None
    squat = estimate_squat_fraction_and_u(
        motion.specific_force - motion.without_gravity, motion, excess
    )
    if squat is not None:
        # on even ground the rest of gravity is smaller than the noise of the pitch
        upright = motion.specific_force - squat[0] * motion.without_gravity
        even = _fit_wheel_comparison(upright, motion, noise, priors, told)
        best = level if even is None or level.mismatch < even.mismatch else even
        # a pitch that is filtered or from a map shows a smaller squat than the wheels do
        shown = not do_wheels_show_squat(best, motion)
        if shown and (best.is_consistent or best.mismatch < found.mismatch):
            return replace(best, squat=squat, pitch_shows_squat=True)
    agrees = level.disagreement_m_s < LIMITS.gravity_disagreement_ratio * found.disagreement_m_s
    if agrees and level.mismatch < LIMITS.gravity_mismatch_ratio * found.mismatch:
        return compare_wheels_after_squat_correction(
            level, motion.without_gravity, motion, noise, priors, told
        )
    return compare_wheels_after_squat_correction(
        found, motion.specific_force, motion, noise, priors, told
    )


def do_wheels_show_squat(wheel_kinematics: WheelKinematics, motion: MotionSamples) -> bool:
    """Whether wheels of known radius show that the accelerometer reads too much, as squat does."""
    radius_u_1 = motion.wheel_radius_u_1
    if radius_u_1 is None or not wheel_kinematics.is_gain_significant:
        return False
    return -wheel_kinematics.gain[0] > LIMITS.gain_min_std * radius_u_1


def compare_wheels_after_squat_correction(
    comparison: WheelKinematics,
    measured_acceleration: Floats,
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    earlier_kinematics: WheelKinematics | None,
) -> WheelKinematics:
    """Correct the accelerometer for a squat that wheels of known radius show.

    A body that pitches as the machine gains speed makes the accelerometer read more than the
    wheels. Grades that recur at every start have the same effect, but leave a residual.
    """
    share, radius_u_1 = -comparison.gain[0], motion.wheel_radius_u_1
    if (
        radius_u_1 is None
        or not do_wheels_show_squat(comparison, motion)
        or share > LIMITS.max_squat_1
    ):
        return comparison
    even = _fit_wheel_comparison(
        measured_acceleration * (1.0 - share), motion, noise, priors, earlier_kinematics
    )
    if even is None or even.is_gain_significant:
        return comparison
    unexplained_m_s = BODY_LIMITS.squat_residual_ratio * comparison.disagreement_m_s
    if not even.is_consistent and even.disagreement_m_s > unexplained_m_s:
        return comparison
    u = float(np.linalg.norm([comparison.gain[1], radius_u_1, LIMITS.speed_scale_squat_u * share]))
    return replace(even, squat=(share, u))


def _fit_wheel_comparison(
    measured_acceleration: Floats,
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    earlier_kinematics: WheelKinematics | None = None,
) -> WheelKinematics | None:
    """Fit the comparison, starting from an earlier one if there is one."""
    slip_std = priors.wheel_slip / motion.force_95_percentile_newtons

    def make_prior_stds(gain_std: float, slip_1_N: float, slip_std: float = slip_std) -> Floats:
        offset = slip_1_N * compute_constant_force_prior_std_of_motion_newtons(motion, priors)
        return np.array([gain_std, slip_std, priors.speed_delay_s, offset])

    def solve_rows(
        rows: ComparisonRows,
        prior_stds: Floats,
        delay_s: float,
        projected_columns: Floats | None,
        autocovariance_loss: Floats | None,
    ) -> prior_fit.PriorSolution | prior_fit.UndeterminedFit:
        grouping = Grouping(
            shortest=10 * MEAN // EVERY, taken=projected_columns, loss=autocovariance_loss
        )
        return prior_fit.solve_with_priors(
            *rows, np.array([0.0, 0.0, -delay_s, 0.0]), prior_stds, grouping
        )

    largest = LIMITS.max_slip_fraction / motion.force_95_percentile_newtons
    delay_s, slip_1_N, about = 0.0, 0.0, slip_std
    if earlier_kinematics is not None:
        delay_s, slip_1_N = earlier_kinematics.delay_s[0], earlier_kinematics.slip_1_N[0]
        about = abs(slip_1_N) + earlier_kinematics.slip_1_N[1]
    spans = find_spans_of_compared_stretches(motion)
    if not spans.size:
        return None
    rows = _make_comparison_rows(
        measured_acceleration, motion.advance_speed(delay_s), spans, noise, slip_1_N
    )
    lines = loss = None
    if earlier_kinematics is not None:
        lines = make_constant_and_slope_of_each_stretch(rows[2])
        loss = compute_autocovariance_loss(rows[2], lines)
    wide = solve_rows(rows, make_prior_stds(LIMITS.gain_search_std_1, about), delay_s, lines, loss)
    for number in range(LIMITS.slip_passes):
        late_s, slips_1_N = float(wide.theta[2]), float(wide.theta[1])
        if not np.isfinite([late_s, slips_1_N]).all():
            break
        if earlier_kinematics is not None and abs(late_s) < LIMITS.delay_tolerance_s:
            break
        # slip is relative to the ground speed, and an offset acts in proportion to the slip
        slip_1_N = float(np.clip(slips_1_N, -largest, largest))
        about = abs(slip_1_N) + (
            wide.fit.parameter_stds[1]
            if earlier_kinematics is None
            else earlier_kinematics.slip_1_N[1]
        )
        # a derivative only approximates a delay: the speed is advanced by it and compared again
        delay_s = float(np.clip(delay_s + late_s, -LIMITS.longest_delay_s, LIMITS.longest_delay_s))
        rows = _make_comparison_rows(
            measured_acceleration, motion.advance_speed(delay_s), spans, noise, slip_1_N
        )
        # only the last one's deviations count
        if lines is None and number == LIMITS.slip_passes - 1:
            lines = make_constant_and_slope_of_each_stretch(rows[2])
            loss = compute_autocovariance_loss(rows[2], lines)
        wide = solve_rows(
            rows, make_prior_stds(LIMITS.gain_search_std_1, about), delay_s, lines, loss
        )
    # a speed without noise is known to its last digit
    rounding_m_s = np.finfo(np.float64).eps * motion.speed_95_percentile_m_s
    noise_m_s = max(float(np.sqrt(noise.compute_covariance_of_means(MEAN)[1, 1])), rounding_m_s)
    free = wide.fit
    least_1 = LIMITS.gain_min_std * estimate_gain_that_noise_mimics(
        rows,
        noise,
        make_prior_stds(LIMITS.gain_search_std_1, about) / max(free.residual_rms, rounding_m_s),
        1.0 / motion.rate_hz,
    )
    if free.theta[1] < -LIMITS.negative_slip_std * free.parameter_stds[1]:
        narrow_std = slip_std * LIMITS.negative_slip_prior_ratio
        stiff = make_prior_stds(LIMITS.gain_search_std_1, about, narrow_std)
        rolling = solve_rows(rows, stiff, delay_s, lines, loss).fit
        if rolling.theta[0] < 0.0 and is_accelerometer_gain_significant(
            rolling, noise_m_s, least_1
        ):
            free, slip_std = rolling, narrow_std
    mismatch = free.residual_rms / noise_m_s
    counts = is_accelerometer_gain_significant(free, noise_m_s, least_1)
    std = make_prior_stds(LIMITS.gain_search_std_1 if counts else priors.gain, about, slip_std)
    found = free if counts else solve_rows(rows, std, delay_s, lines, loss).fit
    # few manoeuvres do not show the full effect of integrated noise
    least = compute_parameter_std_bounds_by_noise(rows, noise, std, 1.0 / motion.rate_hz)
    widened = np.maximum(least / found.parameter_stds, 1.0)
    covariance = found.covariance * np.outer(widened, widened)
    values = list(
        zip(found.theta[:3].tolist(), np.sqrt(np.diag(covariance)).tolist()[:3], strict=True)
    )
    return WheelKinematics(
        gain=(float(free.theta[0]), float(free.parameter_stds[0])),
        gain_by_prior=values[0],
        slip_1_N=values[1],
        delay_s=(delay_s + values[2][0], values[2][1]),
        is_gain_significant=counts,
        covariance=covariance[np.ix_([1, 0, 2], [1, 0, 2])],
        mismatch=mismatch,
        disagreement_m_s=float(np.sqrt(max(free.residual_rms**2 - noise_m_s**2, 0.0))),
        prior_std=std[[1, 0, 2]],
        mean_u=np.zeros(len(TERMS)),
    )


def is_accelerometer_gain_significant(fit: PosteriorFit, noise_m_s: float, least_1: float) -> bool:
    """Whether a gain exceeds what its prior and the noise allow.

    Args:
        fit: fit of the comparison, with the gain first.
        noise_m_s: standard deviation of the noise in means of the speed.
        least_1: largest apparent gain that noise of the accelerometer causes.
    """
    # if wheels and accelerometer are inconsistent, standard deviations mean nothing
    agrees = fit.residual_rms / noise_m_s <= LIMITS.max_kinematic_mismatch
    times = LIMITS.gain_min_std if agrees else 0.0
    return bool(abs(fit.theta[0]) > max(LIMITS.gain_min_1, times * fit.parameter_stds[0], least_1))


def find_spans_of_compared_stretches(motion: MotionSamples) -> Ints:
    """First and end sample of each stretch that is long enough, (stretches, 2)."""
    spans = find_stretch_spans(motion.stretch_of_sample)
    return spans[np.diff(spans)[:, 0] >= 10 * MEAN]


def _make_comparison_rows(
    measured_acceleration: Floats,
    motion: MotionSamples,
    spans: Ints,
    noise: ColumnNoiseModel,
    slip_1_N: float,
) -> ComparisonRows:
    """Columns and response, with a line removed from each stretch, and the noise in them."""
    X, y, group, ground = average_and_detrend_wheel_columns(
        measured_acceleration, motion.speed, motion.force, spans, 1.0 / motion.rate_hz, slip_1_N
    )
    covariance = noise.compute_covariance_of_means(MEAN)
    grams = np.zeros((len(spans), 4, 4))
    grams[:, 1, 1] = ground * covariance[2, 2]
    grams[:, 2, 2] = np.bincount(group) * covariance[0, 0]
    return X, y, group, NoiseMoments(grams, np.zeros((len(spans), 4)))


@compiled_unless_short_log
def average_and_detrend_wheel_columns(
    measured_acceleration: Floats,
    speed: Floats,
    force: Floats,
    spans: Ints,
    step_s: float,
    slip_1_N: float,
) -> tuple[Floats, Floats, Ints, Floats]:
    """Means of columns and response, with a line removed from each stretch.

    Args:
        measured_acceleration: (n,) accelerometer in m/s².
        speed: (n,) wheel speed in m/s.
        force: (n,) force in N.
        spans: (stretches, 2) first and end sample of each stretch.
        step_s: step of the grid in s.
        slip_1_N: slip of the wheels, per newton.

    Returns:
        (rows, 4) columns, (rows,) response, (rows,) stretch, and (stretches,) sum of squares of the
        ground speed.
    """
    counts = (spans[:, 1] - spans[:, 0] - MEAN) // EVERY + 1
    X, y = np.empty((counts.sum(), 4)), np.empty(counts.sum())
    group, squares = np.empty(y.size, np.int64), np.zeros(len(spans))
    row = 0
    for number in range(len(spans)):
        part = slice(spans[number, 0], spans[number, 1])
        a, v, f = measured_acceleration[part], speed[part], force[part]
        gained = (np.cumsum(a) - a / 2.0) * step_s
        # integrated accelerometer: initial speed, tilt and bias are taken from the wheels
        slipping = v * compute_ground_to_wheel_speed_ratio(v, f, slip_1_N) - gained
        ground = np.abs(gained + slipping - subtract_fitted_line(slipping))
        rows = slice(row, row + counts[number])
        y[rows] = subtract_fitted_line(compute_overlapping_means(v - gained))
        X[rows, 0] = subtract_fitted_line(compute_overlapping_means(gained))
        X[rows, 1] = subtract_fitted_line(compute_overlapping_means(ground * f))
        X[rows, 2] = subtract_fitted_line(compute_overlapping_means(-a))
        of_ground = compute_overlapping_means(ground)
        X[rows, 3] = subtract_fitted_line(-of_ground)
        group[rows] = number
        squares[number] = sum_in_order(of_ground * of_ground)
        row += counts[number]
    return X, y, group, squares
