"""The phase of motion, from v·dv/dt and the yaw rate; never from specific force.

A slope of 5° alone puts 0.85 m/s² on the accelerometer, so it cannot tell braking from standing.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.column_arrays import ColumnArrays
from analysis.model.schema import PHASE, get_column_values
from analysis.model.settings import Settings
from analysis.model.windows import find_flagged_runs, flag_windows_with_flagged_rows
from analysis.stages.motion.smooth import compute_trailing_mean
from analysis.stages.stage_limits import LIMITS
from estimators.arrays import Bools, Floats

#: The phases in which the machine turns: straight motion has none of them.
TURNS: Final = ("spinning", "arc", "turning")


def compute_trailing_speed_rate(speed: Floats, settings: Settings) -> Floats:
    """The change of speed over the last `speed_rate_span_s`, (rows,) in m/s²; looks back only.

    NaN where a sample of that span is missing: rows beside a hole may be hours apart.
    """
    span = min(count_rows_in_speed_rate_span(settings), speed.size)
    rate = np.full(speed.size, np.nan)
    rate[span:] = (speed[span:] - speed[: speed.size - span]) * settings.align.rate_hz / span
    rate[np.isnan(compute_trailing_mean(speed, span + 1))] = np.nan
    return rate


def average_acceleration_over_rate_span(acceleration: Floats, settings: Settings) -> Floats:
    """Acceleration (rows,) averaged over the span of the speed rate, to have its delay."""
    return compute_trailing_mean(acceleration, count_rows_in_speed_rate_span(settings))


def count_rows_in_speed_rate_span(settings: Settings) -> int:
    """Number of rows over which the rate of change of a speed is computed, looking back."""
    return max(1, round(settings.phases.speed_rate_span_s * settings.align.rate_hz))


def compute_sign_of_speed_change(
    speed: Floats, speed_rate: Floats, steady_rate: float, settings: Settings
) -> Floats:
    """Sign of the change of v², (rows,): 1 growing, -1 falling, 0 steady; v may be a yaw rate.

    v·dv/dt over the span is the change of v²/2; the sign of v alone would be noise at a stop. Rates
    up to `steady_rate` count as steady.
    """
    changing = np.abs(speed_rate) > steady_rate
    return np.where(
        changing,
        np.sign(_estimate_mean_speed_over_span(speed, speed_rate, settings) * speed_rate),
        0.0,
    )


def compute_sign_of_yaw_rate_change(yaw_rate: Floats, settings: Settings) -> Floats:
    """Whether the turn speeds up (1), slows down (-1) or is steady (0), (rows,)."""
    rate = compute_trailing_speed_rate(yaw_rate, settings)
    return compute_sign_of_speed_change(
        yaw_rate, rate, settings.phases.steady_yaw_acc_rad_s2, settings
    )


def mark_stopping_samples(
    speed: Floats, is_standing: Bools, noise_m_s: float, settings: Settings
) -> Bools:
    """Flags (n,) of samples from which the speed only falls until the machine stands.

    Unmeasured brakes may stop a machine so gently that it counts as cruising.

    Args:
        speed: (n,) in m/s.
        is_standing: (n,) whether the machine stands.
        noise_m_s: change of speed within the noise.
        settings: settings with grid rate and braking threshold.
    """
    phases = settings.phases
    fall_m_s = max(noise_m_s, phases.steady_acc_m_s2 * phases.speed_rate_span_s)
    size = np.nan_to_num(np.abs(speed))
    span = max(1, round(LIMITS.stop_span_s * settings.align.rate_hz))
    found = np.zeros(speed.size, np.bool_)
    ends = np.flatnonzero(is_standing & ~np.append(True, is_standing[:-1]))
    starts = np.flatnonzero(~is_standing & np.append(True, is_standing[:-1]))
    for start, end in zip(starts, ends, strict=False):
        fastest_from = np.maximum.accumulate(size[start:end][::-1])[::-1]
        before = np.append(np.full(span, fastest_from[0]), fastest_from)[: end - start]
        steady = (before <= fastest_from + fall_m_s) & (fastest_from > 2.0 * fall_m_s)
        steady[: np.argmax(size[start:end]) + 1] = True
        found[start + np.flatnonzero(steady)[-1] + 1 : end] = True
    return found


def mark_samples_held_downhill(excitation: pl.DataFrame, settings: Settings) -> Bools:
    """Flags (n,) of samples of a descent with an idle drive, so that unmeasured brakes may act.

    Brakes that hold the speed show neither in the speed nor in the force. Rolling freely counts as
    well; the force of either says nothing of the mass.

    Args:
        excitation: frame with the regressors and phases.
        settings: settings with the grid rate.
    """
    way = np.sign(get_column_values(excitation, "speed_x_m_s"))
    along = average_acceleration_over_rate_span(
        way * get_column_values(excitation, "regressor_acc_x_m_s2"), settings
    )
    force = get_column_values(excitation, "force_x_N")
    known = np.abs(force[np.isfinite(force)])
    if not known.size:
        return np.zeros(force.size, np.bool_)
    idle_N = LIMITS.idle_force_1 * float(np.quantile(known, LIMITS.driving_force_quantile))
    held = (along < -LIMITS.descent_min_m_s2) & (way * force < idle_N)
    for first, last in zip(*find_flagged_runs(held), strict=True):
        if last - first + 1 < LIMITS.stop_span_s * settings.align.rate_hz:
            held[first : last + 1] = False
    return held


def mark_speed_falls_beyond_noise(speed: Floats, noise_m_s: float, settings: Settings) -> Bools:
    """Flags (n,) of samples within a fall of the speed that its noise does not explain.

    Over a short span noise alone makes a cruise fall as fast as braking. Leaving out such rows cuts
    driving into pieces, and chooses among them by the noise of what is fitted.

    Args:
        speed: (n,) in m/s, after the moving mean.
        noise_m_s: standard deviation of such a sample.
        settings: settings with grid rate and braking threshold.
    """
    steady_m_s2, rate_hz = settings.phases.steady_acc_m_s2, settings.align.rate_hz
    span_s = min(LIMITS.fall_min_std * np.sqrt(2.0) * noise_m_s / steady_m_s2, LIMITS.stop_span_s)
    span = math.ceil(span_s * rate_hz)
    if span <= count_rows_in_speed_rate_span(settings) or span >= speed.size:
        return np.ones(speed.size, np.bool_)
    size = np.abs(speed)
    falls = np.ones(speed.size, np.bool_)
    # beside a hole nothing is known against braking
    falls[span:] = ~((size[span:] - size[:-span]) * rate_hz / span >= -steady_m_s2)
    return flag_windows_with_flagged_rows(falls[::-1], span + 1)[::-1]


def _estimate_mean_speed_over_span(speed: Floats, speed_rate: Floats, settings: Settings) -> Floats:
    return (
        speed - speed_rate * count_rows_in_speed_rate_span(settings) / settings.align.rate_hz / 2.0
    )


def classify_motion_phases(
    smoothed: pl.DataFrame | ColumnArrays, speed: Floats, speed_rate: Floats, settings: Settings
) -> pl.Series:
    """Classify the phase of every row; null if the speed or its rate is unknown.

    Without a yaw rate straight driving is assumed. Standstill means slow and steady, so a reversal
    passes through braking and accelerating without a stop.

    Args:
        smoothed: `aligned` after the moving mean.
        speed: (rows,) longitudinal speed in m/s.
        speed_rate: (rows,) its rate in m/s².
        settings: settings with the thresholds.

    Returns:
        (rows,) enum of phases.
    """
    yaw_rate = np.nan_to_num(get_column_values(smoothed, "yaw_rate_rad_s"))
    # a derivative of the gyroscope is too noisy by itself to tell a steady arc
    yaw_acc = average_acceleration_over_rate_span(
        get_column_values(smoothed, "yaw_acc_rad_s2"), settings
    )
    if "yaw_acc_rad_s2" not in smoothed.columns:
        yaw_acc = compute_trailing_speed_rate(yaw_rate, settings)
    mean_speed = _estimate_mean_speed_over_span(speed, speed_rate, settings)
    turning = np.abs(yaw_rate) > settings.phases.turning_rate_rad_s
    slow = np.abs(speed) < settings.phases.standstill_speed_m_s
    steady = np.abs(speed_rate) <= settings.phases.steady_acc_m_s2
    steady_turn = steady & (np.abs(yaw_acc) <= settings.phases.steady_yaw_acc_rad_s2)
    conditions = {
        None: np.isnan(speed) | np.isnan(speed_rate),
        "spinning": turning & slow,
        "arc": turning & steady_turn,
        "turning": turning,
        "standstill": slow & steady,
        "cruising": steady,
        "accelerating": mean_speed * speed_rate > 0,
    }
    return label_by_first_condition(conditions, "braking", PHASE).alias("phase")


def find_first_true_condition(conditions: Sequence[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    """Index of the first true condition for each row, (n,); their number if none is true.

    Args:
        conditions: conditions (n,) in order of precedence.
    """
    count = len(conditions)
    chosen = np.full(conditions[0].size, count, np.uint8)
    # the last first, so that the first that holds has the last word
    for number in reversed(range(count)):
        chosen[conditions[number]] = number
    return chosen


def label_by_first_condition(
    conditions: Mapping[str | None, NDArray[np.bool_]], default_label: str, labels: pl.Enum
) -> pl.Series:
    """Label each row (n,) by the first true condition.

    Args:
        conditions: conditions by label, in order of precedence; the label None gives null.
        default_label: label if no condition is true.
        labels: enum of the series.
    """
    # numbers, since rows of text are slow to make
    choices = _make_label_series((*conditions, default_label), labels)
    return choices[find_first_true_condition(list(conditions.values()))]


@cache
def _make_label_series(names: tuple[str | None, ...], labels: pl.Enum) -> pl.Series:
    return pl.Series(names, dtype=labels)
