"""Causes in one channel: frozen, clipped, or different from the other side.

If the sides differ while the machine drives straight, one sensor, wheel or tyre is wrong. If the
resistance follows that difference, the machine turns.
"""

from collections.abc import Callable
from functools import cache
from itertools import chain
from typing import Final

import numpy as np

from analysis.diagnosis.diagnosis_limits import LIMITS as DIAGNOSIS_LIMITS
from analysis.diagnosis.excluded_stretches import ExcludedStretches
from analysis.diagnosis.measured_channels import find_unexplained_repeats
from analysis.diagnosis.side_comparison import SPEEDS, TORQUES, YAW_RATE_BY_SPEEDS, SideDifference
from analysis.findings.cause import MassChange, Symptom
from analysis.findings.channel_limits import LIMITS
from analysis.findings.finding_inputs import ACCELERATIONS, FORCES, FindingInputs
from analysis.findings.refit import compute_mass_change_by_refit_without_samples
from analysis.findings.sampling_causes import measure_repeat_fraction_and_resolution
from analysis.findings.whitened_rows import (
    compute_sums_of_sample_blocks,
)
from analysis.model.windows import flag_rows_near_flagged_rows
from analysis.weighing.stretch_means import list_indices_of_samples_in_whole_blocks
from estimators.arrays import Floats

#: Causes that a dead channel explains.
_OF_DEAD: Final = ("unsigned", "offset")
_YAW_RATE: Final = "yaw_rate_rad_s"
#: Causes that turns seem to show, besides those of any residual, if they are most of it.
_OF_TURNS: Final = (
    *("delay", "coulomb", "gain_drift", "resonance", "load_changed_inside", "external_force"),
    *("too_little_excitation", "collinear", "braking_inside"),
)
_CHANNELS: Final = {"torque": TORQUES, "speed": SPEEDS, "slip": SPEEDS}


def find_frozen_channel(inputs: FindingInputs) -> list[Symptom]:
    """Find a channel that repeats one reading while another channel changes."""
    signals = inputs.check_inputs.signals
    if signals is None:
        return []
    at_limit = [symptom.channel for symptom in find_speed_stuck_at_its_largest(inputs)]
    # a coarse channel repeats itself while the machine moves steadily
    of_channel = {
        name: spans
        for name in inputs.sensors_in_log
        if name not in at_limit
        and not _do_readings_repeat_by_resolution(inputs, name)
        and (spans := signals.frozen_spans.get(name) or find_noiseless_stretches_ns(inputs, name))
    }
    if not of_channel:
        return []
    total_s = {name: sum(e - b for b, e in spans) / 1e9 for name, spans in of_channel.items()}
    name = max(total_s, key=lambda each: total_s[each])
    spans = of_channel[name]
    t = inputs.aligned["t_ns"].to_numpy() + inputs.check_inputs.t0_unix_ns
    holds = np.zeros(t.size, np.bool_)
    for start, end in chain(*of_channel.values()):
        holds |= (t >= start) & (t <= end)
    found = inputs.check_inputs.left_out.get("frozen_s")

    @cache
    def refit_without_frozen_samples() -> MassChange | None:
        return compute_mass_change_by_refit_without_samples(inputs, holds)

    parts = "" if len(spans) == 1 else f" in {len(spans)} stretches"
    return [
        Symptom(
            total_s[name] / LIMITS.frozen_total_s,
            f"the channel is frozen for {total_s[name]:.1f} s{parts}, while others change"
            f"{_format_mass_change_by_exclusion(found)}",
            channel=name,
            span_ns=inputs.convert_unix_to_aligned_ns(*spans[0]),
            change=refit_without_frozen_samples,
            keeps_answer=does_exclusion_keep_answer(inputs, found, refit_without_frozen_samples),
            explains=_OF_DEAD
            if 1e9 * total_s[name] > LIMITS.dead_fraction * (t[-1] - t[0])
            else (),
        )
    ]


def _format_mass_change_by_exclusion(exclusion: ExcludedStretches | None) -> str:
    return "" if exclusion is None else f"; {exclusion.exclusion_effect_text}"


def does_exclusion_keep_answer(
    inputs: FindingInputs,
    exclusion: ExcludedStretches | None,
    refit: Callable[[], MassChange | None] | None = None,
) -> bool | None:
    """Whether the mass stays the same if the stretches are excluded; None if unknown."""
    fit = inputs.fit_without_learnt_priors
    if fit is None:
        return None
    if exclusion is not None:
        return exclusion.does_exclusion_keep_mass
    # with several loads, the exclusion may change the other masses
    change = refit() if refit is not None and fit.mass_count == 1 else None
    if change is None:
        return None
    return abs(change.kg) <= DIAGNOSIS_LIMITS.harmless_change_u * fit.u_kg


def find_noiseless_stretches_ns(inputs: FindingInputs, channel: str) -> list[tuple[int, int]]:
    """Long repeats in motion of a channel that has none elsewhere: start and end in Unix ns."""
    signals = inputs.check_inputs.signals
    if signals is None:
        return []
    limits = signals.fraction_by_clipping_level_of_channel.get(channel, {})
    runs, never = find_unexplained_repeats(*inputs.unfiltered_readings[channel])
    # without the last readings of a standstill, which a slow channel repeats beyond its end
    return [
        (run.start_ns, run.end_ns)
        for run in runs
        if never
        and run.value not in limits
        and not any(
            start - LIMITS.stand_edge_ns <= run.start_ns
            and run.end_ns <= end + LIMITS.stand_edge_ns
            for start, end in signals.standstill_spans
        )
        and not does_machine_stand_between(inputs, channel, run.start_ns, run.end_ns)
    ]


def does_machine_stand_between(
    inputs: FindingInputs, channel: str, start_unix_ns: int, end_unix_ns: int
) -> bool:
    """Whether the machine stands between two stamps; the force decides if a speed may be stuck."""
    edges_ns = inputs.convert_unix_to_aligned_ns(
        start_unix_ns + LIMITS.stand_edge_ns, end_unix_ns - LIMITS.stand_edge_ns
    )
    inside = slice(*np.searchsorted(inputs.aligned["t_ns"].to_numpy(), edges_ns).tolist())
    stands = inputs.is_standing_sample[inside]
    if channel in ACCELERATIONS or not stands.size or not stands.all():
        return False
    if channel not in inputs.speed_channels:
        return True
    return bool(inputs.is_idle_sample[inside].mean() > LIMITS.idle_samples_fraction)


def find_saturation(inputs: FindingInputs) -> list[Symptom]:
    """Find force readings that accumulate at an extreme value, and a speed that stays at one."""
    return [*find_clipped_force(inputs), *find_speed_stuck_at_its_largest(inputs)]


def find_clipped_force(inputs: FindingInputs) -> list[Symptom]:
    """Find force readings that accumulate at an extreme value."""
    signals = inputs.check_inputs.signals
    if signals is None or not (clipped := signals.clipped_fraction_and_limit_by_channel):
        return []
    name = max(clipped, key=lambda each: clipped[each][0])
    share, extreme = clipped[name]
    if not share:
        return []
    if name in FORCES:
        count = sum(1 for each, _ in clipped.values() if each > 0.0)
        at = inputs.force_newtons_per_channel_unit(name) * abs(extreme) * max(count, 1)
    else:
        at = inputs.compute_median_force_newtons_in_spans(signals.clipped_spans[name])
    limit_N = 0.98 * at
    found = inputs.check_inputs.left_out.get("clipped_share")

    def refit_without_saturated_rows() -> MassChange | None:
        fit = inputs.fit_without_learnt_priors
        if fit is None:
            return None
        near = flag_rows_near_flagged_rows(np.abs(fit.motion.force) > limit_N, 5)
        return compute_mass_change_by_refit_without_samples(inputs, near)

    # an error code lies far outside all readings, unlike a limit of the sensor
    setting, value = inputs.propose_valid_range_settings(name)
    if setting is None and np.isfinite(limit_N):
        setting, value = "settings.gate.saturation_force_N", f"{limit_N:.1f}"
    return [
        Symptom(
            share / LIMITS.clipped_fraction,
            f"{share:.1%} of its readings are clipped at {extreme:.4g}"
            f"{_format_mass_change_by_exclusion(found)}",
            channel=name,
            setting=setting,
            value=value,
            change=refit_without_saturated_rows,
            keeps_answer=does_exclusion_keep_answer(inputs, found),
        )
    ]


def find_speed_stuck_at_its_largest(inputs: FindingInputs) -> list[Symptom]:
    """Find a speed that freezes only at its largest reading, while other channels change."""
    signals = inputs.check_inputs.signals
    if signals is None:
        return []
    for name in inputs.speed_channels:
        spans = signals.frozen_spans.get(name)
        if not spans:
            continue
        unix_ns, readings = inputs.unfiltered_readings[name]
        firsts = np.abs(readings[np.searchsorted(unix_ns, [start for start, _ in spans])])
        largest = float(np.abs(readings).max())
        if firsts.min() < LIMITS.stuck_at_largest_1 * largest:
            continue
        total_s = sum(end - start for start, end in spans) / 1e9
        return [
            Symptom(
                total_s / LIMITS.frozen_total_s,
                f"it stays at its largest reading, {largest:.4g}, for {total_s:.1f} s in "
                f"{len(spans)} stretches, while others change",
                channel=name,
                span_ns=inputs.convert_unix_to_aligned_ns(*spans[0]),
                explains=("imu_misaligned",),
            )
        ]
    return []


def _do_readings_repeat_by_resolution(inputs: FindingInputs, channel: str) -> bool:
    """Whether readings repeat because of the channel's resolution."""
    repeats, lsb = measure_repeat_fraction_and_resolution(inputs, channel)
    return bool(lsb) and repeats > LIMITS.repeated_fraction


def find_largest_side_difference(inputs: FindingInputs) -> list[Symptom]:
    """Find the largest difference between the left and right side."""
    found = [
        _make_side_difference_symptom(inputs, each)
        for each in inputs.check_inputs.side_differences.values()
    ]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _make_side_difference_symptom(inputs: FindingInputs, difference: SideDifference) -> Symptom:
    least = LIMITS.unlike_slip_1 if difference.kind == "slip" else LIMITS.unlike_sides_1
    strength = abs(difference.value_1) / max(
        least + difference.resistance_1, DIAGNOSIS_LIMITS.sides_min_std * difference.std_1
    )
    left, right = _CHANNELS[difference.kind]
    smaller, larger = (left, right) if difference.smaller_side == "left" else (right, left)
    other = "right" if difference.smaller_side == "left" else "left"
    if difference.kind == "torque":
        return Symptom(
            strength,
            f"on straight drives the {difference.smaller_side} torque is "
            f"{difference.side_ratio_1:.1%} (± {difference.std_1:.1%}) of the {other} one: "
            "one of the two is wrong",
            channel=smaller,
            change=lambda: estimate_mass_change_by_smaller_side(inputs, difference),
        )
    if difference.kind == "slip":
        return Symptom(
            strength,
            f"relative to the gyroscope, the {other} wheels turn faster than the "
            f"{difference.smaller_side} ones by {abs(difference.value_1):.1%} ± "
            f"{difference.std_1:.1%} more in hard starts than in gentle ones",
            channel=larger,
            change=lambda: bound_mass_change_by_wheel_speed_error(inputs),
            alternatives=("slip",),
        )
    wrong = find_contradicted_wheel_speed_and_scale(inputs, difference)
    setting, value = (
        (None, None) if wrong is None else inputs.propose_scale_settings((wrong[0],), wrong[1])
    )
    by_imu = (
        ""
        if wrong is None
        else f"; the accelerometer agrees with the {_name_channel_of_opposite_side(wrong[0])} ones"
    )
    return Symptom(
        strength,
        f"relative to the gyroscope, the {other} wheels turn faster than the "
        f"{difference.smaller_side} ones by {abs(difference.value_1):.1%} ± "
        f"{difference.std_1:.1%} on straight drives{by_imu}",
        channel=larger if wrong is None else wrong[0],
        setting=setting,
        value=value,
        change=lambda: bound_mass_change_by_wheel_speed_error(inputs),
    )


def _name_channel_of_opposite_side(channel: str) -> str:
    return "right" if channel == SPEEDS[0] else "left"


def find_contradicted_wheel_speed_and_scale(
    inputs: FindingInputs, difference: SideDifference
) -> tuple[str, float] | None:
    """Wheel speed that the accelerometer contradicts, and the factor for its scale."""
    fit = inputs.fit_without_learnt_priors
    wheels = None if fit is None else fit.kinematics
    if wheels is None or not wheels.is_consistent:
        return None
    gains = [(1.0 + wheels.gain[0]) * (1.0 + way * difference.value_1 / 2.0) for way in (-1.0, 1.0)]
    if min(gains) <= 0.0:
        return None
    off = np.abs(np.log(gains))
    right = int(np.argmin(off))
    if off[right] > LIMITS.right_side_1 or off[1 - right] < off[right] + LIMITS.wrong_side_1:
        return None
    return SPEEDS[1 - right], gains[right] / gains[1 - right]


def estimate_mass_change_by_smaller_side(
    inputs: FindingInputs, difference: SideDifference
) -> MassChange | None:
    """Mass change if the smaller side is wrong; u equals it, as the larger side may be wrong."""
    fit = inputs.fit_without_learnt_priors
    if fit is None or difference.side_ratio_1 <= -1.0:
        return None
    kg = abs(fit.mass_kg) * (2.0 / (1.0 + max(difference.side_ratio_1, 0.0)) - 1.0)
    return MassChange(kg, kg)


def bound_mass_change_by_wheel_speed_error(inputs: FindingInputs) -> MassChange | None:
    """Mass change of 0, with half the answer's u as its u; None without an accelerometer."""
    fit = inputs.fit_without_learnt_priors
    return (
        None if fit is None or not fit.motion.by_accelerometer else MassChange(0.0, 0.5 * fit.u_kg)
    )


def find_turns_without_yaw_rate(inputs: FindingInputs) -> list[Symptom]:
    """Find a resistance that grows with the difference of the sides' speeds, as in curves."""
    fit, signals, width_m = (
        inputs.fit_without_learnt_priors,
        inputs.unfiltered_readings,
        inputs.machine.machine.track_width_m,
    )
    if fit is None or _YAW_RATE in inputs.machine.channels or not set(SPEEDS) <= set(signals):
        return []
    motion, t = fit.motion, inputs.aligned["t_ns"].to_numpy() + inputs.check_inputs.t0_unix_ns
    left, right = (
        np.interp((t - t[0]).astype(np.float64), (stamps - t[0]).astype(np.float64), x)
        for stamps, x in (signals[name] for name in SPEEDS)
    )
    size = max(round(LIMITS.turn_mean_s * motion.rate_hz), 1)
    used = list_indices_of_samples_in_whole_blocks(motion.stretch_of_sample, size)
    resistance_N = motion.force - inputs.look_up_mass_of_samples_kg(motion) * motion.acceleration
    columns = (resistance_N, right - left, motion.force, motion.acceleration, motion.speed)
    resistance_N, difference, force_N, acceleration, speed = (
        compute_sums_of_sample_blocks(x[used], size) / size for x in columns
    )
    if speed.size < LIMITS.turn_min_blocks or not difference.any():
        return []
    # unlike wheels differ in proportion to the speed, and slip on one side to the force
    straight = np.column_stack([speed, force_N, force_N * np.abs(speed)])
    if compute_explained_fraction(straight, difference) > LIMITS.turn_max_explained_by_straight_1:
        return []
    direction = np.sign(speed)
    A = np.column_stack([acceleration, speed, direction, np.ones_like(speed)])
    scrub, left_N = (
        x - A @ np.linalg.lstsq(A, x)[0] for x in (direction * np.abs(difference), resistance_N)
    )
    if not (scrub.any() and left_N.any()):
        return []
    slope = max(float(scrub @ left_N) / float(scrub @ scrub), 0.0)
    explained_1 = slope * float(scrub @ left_N) / float(left_N @ left_N)
    mean_N = slope * float(np.abs(difference).mean())
    return [
        Symptom(
            explained_1 / LIMITS.turn_explained_1,
            f"the resistance grows with the difference of the two sides' speeds, by {mean_N:.0f} N "
            f"on average over all driving: {explained_1:.0%} of its unexplained variance; without "
            "a yaw rate, curves are fitted as straight drives; "
            f"{_YAW_RATE} = {YAW_RATE_BY_SPEEDS} excludes them"
            + ("" if width_m else ", if machine.track_width_m is stated"),
            channel=SPEEDS[0],
            setting=f"channels.{_YAW_RATE}.derive" if width_m else None,
            value=f'"{YAW_RATE_BY_SPEEDS}"' if width_m else None,
            explains=_OF_TURNS if explained_1 > LIMITS.turn_mostly_explained_1 else (),
        )
    ]


def compute_explained_fraction(A: Floats, x: Floats) -> float:
    """Fraction of the sum of squares of `x` (n,), not all 0, that the columns (n, p) explain."""
    left = x - A @ np.linalg.lstsq(A, x)[0]
    return 1.0 - float(left @ left) / float(x @ x)
