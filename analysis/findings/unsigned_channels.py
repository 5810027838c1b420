"""Channels without a sign, such as a motor current as force or pulses as speed."""

import numpy as np

from analysis.diagnosis.check_inputs import AxisMotion
from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.stages.signals.grid_rate import count_rows_in_duration


def find_unsigned_channel(inputs: FindingInputs) -> list[Symptom]:
    """Find a force or a speed that is never negative although the machine drives both ways."""
    return _find_unsigned_force(inputs) or find_unsigned_speed(inputs)


def find_unsigned_speed(inputs: FindingInputs) -> list[Symptom]:
    """Find a speed that is never negative although forces of both signs make it rise."""
    names, straight = inputs.speed_channels, inputs.check_inputs.straight_motion
    speeding = straight.speeding
    if (
        not names
        or not speeding.any()
        or not all(has_channel_lost_its_sign(inputs, n) for n in names)
    ):
        return []
    size = np.abs(straight.f)
    drives = speeding & (size > LIMITS.unsigned_force_fraction * np.quantile(size[speeding], 0.99))
    directions = [drives & (straight.f < 0.0), drives & (straight.f > 0.0)]
    fewer = float(min(each.sum() for each in directions) / max(drives.sum(), 1))
    if fewer < LIMITS.unsigned_reverse_fraction:
        return []
    # a retarder on a descent lets the speed rise as well, but not as the motor does
    rate = np.gradient(straight.speed_or_yaw_rate)
    # a mean, since most changes of a coarse speed are 0
    rates, forces = ([float(np.mean(x[each])) for each in directions] for x in (rate, size))
    masses = forces[0] * rates[1], forces[1] * rates[0]
    if min(rates) <= 0.0 or max(masses) > LIMITS.unsigned_mass_ratio * min(masses):
        return []
    return [
        Symptom(
            LIMITS.sign_rank * fewer / LIMITS.unsigned_reverse_fraction,
            "its readings are never below zero, although the force drives the machine both ways "
            f"({fewer:.0%} of the driving is in the rarer direction)",
            channel=names[0],
        )
    ]


def _find_unsigned_force(inputs: FindingInputs) -> list[Symptom]:
    """Find a force that is never negative although the machine reverses or brakes."""
    name = inputs.force_channel
    if name is None:
        return []
    opposing = inputs.value_by_check.get("raw_opposing_share", np.nan)
    if not np.isfinite(opposing):
        opposing = inputs.value_by_check.get("opposing_share", np.nan)
    straight = inputs.check_inputs.straight_motion
    if not straight.complete.any():
        return []
    fewest = count_rows_in_duration(
        LIMITS.unsigned_braking_s,
        inputs.machine.settings.align.rate_hz,
        LIMITS.unsigned_min_samples,
    )
    brakes = (
        np.count_nonzero(straight.braking) >= fewest
        and opposing <= LIMITS.unsigned_opposing_fraction
    )
    lost, nearly = has_channel_lost_its_sign(inputs, name), is_negative_only_by_noise(straight)
    backwards = does_machine_drive_in_reverse(straight) and (
        lost or (nearly and is_force_positive_in_reverse(straight))
    )
    if not (
        backwards or (brakes and (lost or (nearly and is_force_positive_while_braking(straight))))
    ):
        return []
    high = float(np.quantile(inputs.unfiltered_readings[name][1], 0.99))
    return [
        Symptom(
            LIMITS.sign_rank,
            f"its readings reach {high:.3g} and are never below zero, although the machine "
            + (
                "drives in reverse"
                if backwards
                else f"slows down in {np.count_nonzero(straight.braking)} samples"
            ),
            channel=name,
        )
    ]


def does_machine_drive_in_reverse(straight: AxisMotion) -> bool:
    """Whether the machine drives backwards for a part of the log."""
    reverses = straight.speed_or_yaw_rate[straight.complete] < -LIMITS.reverse_speed_m_s
    return float(reverses.mean()) > LIMITS.unsigned_reverse_min_fraction


def is_force_positive_in_reverse(straight: AxisMotion) -> bool:
    """Whether the force in reverse is far above zero, so that it is more than rolling friction."""
    reverses = straight.complete & (straight.speed_or_yaw_rate < -LIMITS.reverse_speed_m_s)
    largest_N, reversing_N = (
        np.quantile(straight.f[each], 0.99) for each in (straight.complete, reverses)
    )
    return bool(reversing_N > LIMITS.unsigned_force_fraction * largest_N)


def is_negative_only_by_noise(straight: AxisMotion) -> bool:
    """Whether the force is negative by no more than noise about zero."""
    low, high = np.quantile(straight.f[straight.complete], [0.001, 0.99])
    return bool(-low < LIMITS.unsigned_noise_fraction * high)


def is_force_positive_while_braking(straight: AxisMotion) -> bool:
    """Whether the force is far above zero in most samples in which the machine slows down."""
    far_N = LIMITS.unsigned_force_fraction * np.quantile(straight.f[straight.complete], 0.99)
    return bool(np.median(straight.f[straight.braking]) > far_N)


def has_channel_lost_its_sign(inputs: FindingInputs, channel: str) -> bool:
    """Whether a channel is never negative, not even by noise about zero."""
    return (
        float((inputs.unfiltered_readings[channel][1] < 0.0).mean())
        < LIMITS.unsigned_negative_fraction
    )
