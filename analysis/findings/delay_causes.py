"""Delays: find which of force, wheels and accelerometer is delayed.

The likelihood of the equation covers delays up to a fifth of a second. A longer one, such as that
of a GNSS speed, mimics other causes (friction, a misaligned accelerometer, a frozen speed) and is
therefore searched for first, by the correlation of whole channels.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from analysis.expressions.parse import format_unit_for_pint
from analysis.findings.altered_motion import correct_channel_delay
from analysis.findings.cause import Symptom
from analysis.findings.constant_forces import compute_gravity_by_pitch_m_s2
from analysis.findings.finding_inputs import ACC, FORCES, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.likelihood_search import FittedCause, rank_causes_by_likelihood
from analysis.findings.refit import compute_mass_change_by_refit
from analysis.findings.signal_lag import (
    SignalLag,
    estimate_lag_and_std_s,
    estimate_lag_of_signal,
    find_parabola_peak_offset_steps,
)
from analysis.findings.unsigned_channels import find_unsigned_speed
from analysis.model.schema import get_column_values
from analysis.model.windows import flag_windows_with_flagged_rows
from analysis.stages.motion.forces import compute_longitudinal_force
from analysis.stages.signals.derive import find_unit_in_name
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.stages.signals.rates import find_source_channels
from analysis.weighing.friction_warming import WARMING
from estimators.arrays import Bools, Floats

#: Causes that a long delay mimics.
EXPLAINED_BY_LONG: Final = (
    *("sign_flipped", "unsigned", "wrong_unit", "wrong_scale", "unlike_sides", "frozen"),
    *("imu_misaligned", "imu_bias", "slope", "offset", "imu_low_passed", "wheel_radius", "slip"),
    *("coulomb", "driveline", "gain_drift", "braking_inside", "braking_left_out", "resonance"),
    *("external_force", "load_changed_inside", "heteroscedastic", "coloured_residuals"),
    *("too_little_excitation", "collinear", "imu_loose", "spikes", "gain_by_speed"),
)
#: Causes that a delay between two sensors of the force mimics, besides those of any delay.
EXPLAINED_BY_SOURCE: Final = ("braking_inside", "braking_left_out", "unlike_sides")
#: Units of channels of which several make up a force.
_FORCE_UNITS: Final = ("N", "kN", "N*m", "kN*m", "A", "percent", "Pa", "bar")
_SHOWN: Final = {"force": "force", "speed": "speed", "imu": "accelerometer"}


@dataclass(frozen=True)
class LongDelay:
    """A channel with a delay of more than a fifth of a second.

    Attributes:
        channel: `force`, `speed` or `imu`.
        delay_s: the delay; negative if the channel is early.
        correlation: correlation with another channel, after and before correcting the delay.
        rival: channel that may be early instead, if no third channel decides; else "".
    """

    channel: str
    delay_s: float
    correlation: tuple[float, float]
    rival: str = ""


def find_channel_with_long_delay(inputs: FindingInputs) -> LongDelay | None:
    """Find the channel with a long delay; None without one.

    With three channels it is the one that lags behind the other two, which agree.
    """
    if "long delay" not in inputs.cache:
        inputs.cache["long delay"] = _search_channel_with_long_delay(inputs)
    return inputs.cache["long delay"]  # type: ignore[return-value]


def _search_channel_with_long_delay(inputs: FindingInputs) -> LongDelay | None:
    step_s, channels = make_acceleration_signals_and_step_s(inputs)
    if not {"speed", "force"} <= channels.keys():
        return None
    speed, force = channels["speed"], channels["force"]
    drives = np.abs(force) > LIMITS.driving_force_fraction * float(np.quantile(np.abs(force), 0.98))
    if "imu" not in channels:
        seen = _estimate_force_lag_while_driving(force, speed, channels["v"], drives, step_s)
        if not _does_long_shift_restore_correlation(seen):
            return None
        # two channels do not show which one is wrong; sensors are late more often than early
        late, rival = ("force", "speed") if seen.lag_s > 0.0 else ("speed", "force")
        return LongDelay(late, abs(seen.lag_s), seen[1:], rival)
    imu = channels["imu"]
    seen = estimate_lag_of_signal(speed, imu, step_s)
    if _does_long_shift_restore_correlation(seen):
        # the channel that starts together with the force has no delay
        before = round(LIMITS.driving_start_s / step_s)
        rows = flag_windows_with_flagged_rows(drives[::-1], before)[::-1]
        v = channels["v"]
        later = np.interp(np.arange(v.size) + seen.lag_s / step_s, np.arange(v.size), v)
        by_imu, by_speed = (
            _sum_squared_force_residuals(
                force, np.column_stack([acceleration, along, np.ones(v.size)]), rows
            )
            for acceleration, along in ((imu, later), (speed, v))
        )
        if by_imu < by_speed:
            return LongDelay("speed", seen.lag_s, seen[1:])
        return LongDelay("imu", -seen.lag_s, seen[1:])
    seen = _estimate_force_lag_while_driving(force, imu, channels["v"], drives, step_s)
    return (
        LongDelay("force", seen.lag_s, seen[1:])
        if _does_long_shift_restore_correlation(seen)
        else None
    )


def _does_long_shift_restore_correlation(lag: SignalLag) -> bool:
    """Whether a long shift restores the correlation, or explains most of the unexplained rest."""
    delay_s, after, before = lag
    # a strong negative correlation without a shift is a wrong sign
    is_correlation_restored = abs(before) < LIMITS.delayed_correlation_ratio * after
    # slow motion correlates despite a delay, and the likelihood search does not reach that far
    is_rest_explained = (1.0 - after**2) < LIMITS.delayed_rest_ratio * (1.0 - before**2)
    if not is_correlation_restored and abs(delay_s) <= LIMITS.longest_likelihood_delay_s:
        return False
    return (
        abs(delay_s) > LIMITS.shortest_long_delay_s
        and after > LIMITS.same_motion_correlation
        and (is_correlation_restored or is_rest_explained)
    )


def _sum_squared_force_residuals(force: Floats, columns: Floats, used_rows: Bools) -> float:
    """Sum of squared force residuals of the equation of motion, in N²."""
    A, f = columns[used_rows], force[used_rows]
    left = f - A @ np.linalg.lstsq(A, f, rcond=None)[0]
    return float(left @ left)


def compute_partial_force_acceleration_correlation(
    force: Floats, acceleration: Floats, speed: Floats
) -> float:
    """Partial correlation of force and acceleration about 0, given the speed.

    Friction in the force follows the speed, which is the integral of the acceleration.
    """
    friction = np.column_stack([speed, np.sign(speed)])
    both = np.column_stack([force, acceleration])
    f, a = (both - friction @ np.linalg.lstsq(friction, both, rcond=None)[0]).T
    size = float(np.linalg.norm(f) * np.linalg.norm(a))
    return float(f @ a) / size if size else 0.0


def _estimate_force_lag_while_driving(
    force: Floats, acceleration: Floats, speed: Floats, is_driving: Bools, step_s: float
) -> SignalLag:
    """Lag of the force where no brakes act, with the same fields as `estimate_lag_of_signal`."""
    longest = round(LIMITS.longest_delay_s / step_s)
    inside = is_driving.copy()
    inside[:longest] = inside[-longest:] = False
    seen = [
        compute_partial_force_acceleration_correlation(
            force[inside], np.roll(acceleration, k)[inside], np.roll(speed, k)[inside]
        )
        for k in range(-longest, longest + 1)
    ]
    at = int(np.argmax(seen))
    inside_search = 0 < at < len(seen) - 1
    part = (
        find_parabola_peak_offset_steps(np.array(seen[at - 1 : at + 2])) if inside_search else 0.0
    )
    return SignalLag((at - longest + part) * step_s, seen[at], seen[longest])


def make_acceleration_signals_and_step_s(inputs: FindingInputs) -> tuple[float, dict[str, Floats]]:
    """Block means of the signals that the search for delays compares, and their step.

    Returns:
        Step in s; and the signals (n,) by name: accelerations by `speed`, `force` and `imu`, each
        without its mean, and the speed `v`. No signals if the log is too short.
    """
    rate_hz = inputs.machine.settings.align.rate_hz
    size = count_rows_in_duration(LIMITS.delay_mean_s, rate_hz)
    count = min(inputs.aligned.height, round(LIMITS.delay_search_span_s * rate_hz)) // size

    def average_blocks(x: Floats) -> Floats:
        return x[: count * size].reshape(count, size).mean(axis=1)

    def subtract_mean(x: Floats) -> Floats:
        return np.nan_to_num(x - np.nanmean(x))

    # a slope needs two means
    if count < max(2 * round(LIMITS.longest_delay_s * rate_hz / size), 2):
        return size / rate_hz, {}
    speed = average_blocks(get_column_values(inputs.aligned, "speed_x_m_s"))
    force = average_blocks(compute_longitudinal_force(inputs.aligned, inputs.machine.machine))
    if not (np.isfinite(speed).any() and np.isfinite(force).any()):
        return size / rate_hz, {}
    # a central difference has no delay
    found = {"speed": np.gradient(speed) * rate_hz / size, "force": force}
    if inputs.select_measured_channels(ACC):
        found["imu"] = average_blocks(
            get_column_values(inputs.aligned, ACC) - compute_gravity_by_pitch_m_s2(inputs)
        )
    channels = {
        name: subtract_mean(x)
        for name, x in found.items()
        if np.isfinite(x).any() and np.nanstd(x) > 0.0
    }
    return size / rate_hz, {**channels, "v": np.nan_to_num(speed)}


def find_channel_delays(inputs: FindingInputs) -> list[Symptom]:
    """Find late channels by the likelihood of f(t - d) = m a + b v, with m and b refitted."""
    of_sources = find_delays_between_force_sources(inputs)
    is_source_late = any(each.strength >= 1.0 for each in of_sources)
    late = find_channel_with_long_delay(inputs)
    if late is not None and not (is_source_late and late.channel == "force"):
        # a speed that has lost its sign looks delayed by half of a start
        return [] if find_unsigned_speed(inputs) else [_make_long_delay_symptom(inputs, late)]
    # a delay of one part of the force looks like a delay of the whole
    found = [
        fitted_cause
        for name, fitted_cause in rank_causes_by_likelihood(inputs).items()
        if name.startswith("delay") and not (is_source_late and name == "delay:force")
        if abs(fitted_cause.value) >= LIMITS.min_delay_s
    ]
    whole = (
        _make_delay_symptom(inputs, p) for p in found if not is_likelier_accelerometer_filter(p)
    )
    return [*of_sources, *whole]


def find_delays_between_force_sources(inputs: FindingInputs) -> list[Symptom]:
    """Find a sensor that is late against another sensor of the force."""
    found: list[Symptom] = []
    for first, second in combinations(list_force_source_channels(inputs), 2):
        seen = estimate_lag_and_std_s(
            inputs.unfiltered_readings[second], inputs.unfiltered_readings[first]
        )
        if seen is None:
            continue
        lag_s, std_s = abs(seen[0]), seen[1]
        late, other = (second, first) if seen[0] > 0.0 else (first, second)
        setting, value = inputs.propose_delay_settings((late,), lag_s)
        is_long = lag_s > LIMITS.longest_likelihood_delay_s
        found.append(
            Symptom(
                lag_s / max(LIMITS.source_delay_s, LIMITS.source_delay_std * std_s),
                f"{1e3 * lag_s:.1f} ± {1e3 * std_s:.1f} ms late relative to {other}, or {other} is "
                "early",
                channel=late,
                setting=setting,
                value=value,
                explains=EXPLAINED_BY_LONG if is_long else EXPLAINED_BY_SOURCE,
            )
        )
    return found


def list_force_source_channels(inputs: FindingInputs) -> tuple[str, ...]:
    """Channels of one kind of unit that together give the force; empty if fewer than two."""
    machine = inputs.machine
    whole = ("force_x_N",) if "force_x_N" in machine.channels else FORCES
    sources = frozenset[str]().union(*(find_source_channels(each, machine) for each in whole))
    measured = inputs.select_measured_channels(*sorted(sources))
    units = {name: format_unit_for_pint(find_unit_in_name(name)) for name in measured}
    by_unit = ([n for n in measured if units[n] == unit] for unit in _FORCE_UNITS)
    return next((tuple(each) for each in by_unit if len(each) > 1), ())


def find_accelerometer_filter_delay(inputs: FindingInputs) -> list[Symptom]:
    """Find an accelerometer that a filter delays, beyond a delay of its stamps."""
    found = rank_causes_by_likelihood(inputs).get("delay:imu")
    if found is None or not is_likelier_accelerometer_filter(found):
        return []
    return [
        replace(
            _make_delay_symptom(inputs, found), alternatives=("delay",), setting=None, value=None
        )
    ]


def is_delay_that_masks_other_causes(cause: str, strength: float | None) -> bool:
    """Whether a finding is a delay that masks all other causes."""
    return cause == "delay" and strength is not None and strength >= LIMITS.long_delay_rank


def is_likelier_accelerometer_filter(fitted_cause: FittedCause) -> bool:
    """Whether a delay is better explained by a filter of the accelerometer."""
    return fitted_cause.name == "delay:imu" and fitted_cause.value > LIMITS.filter_delay_s


def _make_delay_symptom(inputs: FindingInputs, fitted_cause: FittedCause) -> Symptom:
    fitted_channel = fitted_cause.name.partition(":")[2]
    fitted_s, std_s = fitted_cause.value, fitted_cause.std
    # two channels do not show which one is wrong; sensors are late more often than early
    is_ambiguous = not inputs.has_accelerometer and bool(inputs.speed_channels)
    is_speed_late = is_ambiguous and fitted_channel == "force" and fitted_s < 0.0
    channel, delay_s = ("speed", -fitted_s) if is_speed_late else (fitted_channel, fitted_s)
    names = _list_log_channels_of_motion_channel(inputs, channel)
    setting, value = inputs.propose_delay_settings(names, delay_s)
    # a longer delay, or a filter, also ends at the limit of the search
    is_at_end = abs(delay_s) >= LIMITS.longest_likelihood_delay_s
    beside = _list_other_motion_channels(inputs, channel)
    rivals = [each for each in beside if f"delay:{each}" in fitted_cause.rivals]
    words = "late" if delay_s > 0 else "early"
    against = " and ".join(_SHOWN[each] for each in beside)
    size = f"{abs(1e3 * delay_s):.1f} ± {1e3 * std_s:.1f} ms"
    size = f"{1e3 * LIMITS.longest_likelihood_delay_s:.0f} ms or more" if is_at_end else size
    said = f"{size} {words} relative to {against}"
    if not inputs.has_accelerometer:
        other = "early" if delay_s > 0.0 else "late"
        said += f", or the {against} is {other}: two channels cannot show which"
    elif rivals:
        said += (
            f"; it is equally likely that the {' or '.join(_SHOWN[each] for each in rivals)} is "
            "delayed or early"
        )
    smooth = channel == "imu" and delay_s > 0
    others = [n for n in fitted_cause.rivals if not n.startswith("delay") and n not in WARMING]
    # a channel ahead of the accelerometer may have no error, if the accelerometer is filtered
    filtered = smooth or (delay_s < 0.0 and "imu" in rivals)
    return Symptom(
        min(
            float(np.sqrt(fitted_cause.gain)) / LIMITS.likelihood_gain_root,
            abs(delay_s) / LIMITS.trusted_stamp_s,
            # at the limit of the search the gain is that of the last step, not of the delay
            abs(delay_s) / (LIMITS.term_min_std * std_s),
        ),
        said,
        channel=next(iter(names), None),
        setting=setting if names and not is_at_end else None,
        value=value if names and not is_at_end else None,
        # correcting a delay does not correct a low-pass
        change=None
        if smooth or is_at_end
        else lambda: compute_mass_change_by_refit(
            inputs,
            lambda motion: correct_channel_delay(motion, fitted_channel, fitted_s),
            min(std_s / abs(delay_s), 1.0),
        ),
        alternatives=(*others, *(("imu_low_passed",) if filtered else ())),
    )


def _make_long_delay_symptom(inputs: FindingInputs, long_delay: LongDelay) -> Symptom:
    names = _list_log_channels_of_motion_channel(inputs, long_delay.channel)
    setting, value = inputs.propose_delay_settings(names, long_delay.delay_s)
    words = "late" if long_delay.delay_s > 0.0 else "early"
    rest = (
        [long_delay.rival]
        if long_delay.rival
        else _list_other_motion_channels(inputs, long_delay.channel)
    )
    against = " and ".join(_SHOWN[each] for each in rest)
    others = (
        f", or the {_SHOWN[long_delay.rival]} is early: two channels cannot show which"
        if long_delay.rival
        else ""
    )
    return Symptom(
        LIMITS.long_delay_rank,
        f"{abs(long_delay.delay_s):.2f} s {words} relative to {against}: the correlation is "
        f"{long_delay.correlation[0]:.2f} with this shift and "
        f"{long_delay.correlation[1]:.2f} without{others}",
        channel=next(iter(names), None),
        setting=setting if names else None,
        value=value if names else None,
        # a late channel may have been filtered
        alternatives=("imu_low_passed",)
        if long_delay.channel == "imu" and long_delay.delay_s > 0.0
        else (),
        explains=EXPLAINED_BY_LONG,
    )


def _list_other_motion_channels(inputs: FindingInputs, motion_channel: str) -> list[str]:
    """The other measured channels among `force`, `speed` and `imu`."""
    return [
        each
        for each in _SHOWN
        if each != motion_channel and (each != "imu" or inputs.has_accelerometer)
    ]


def _list_log_channels_of_motion_channel(
    inputs: FindingInputs, motion_channel: str
) -> tuple[str, ...]:
    """Channels of the log that `force`, `speed` or `imu` is computed from."""
    if motion_channel == "force":
        return inputs.select_measured_channels("force_x_N") or inputs.select_measured_channels(
            "torque_left_N_m", "torque_right_N_m"
        )
    if motion_channel == "speed":
        return inputs.speed_channels
    return inputs.select_measured_channels(ACC)
