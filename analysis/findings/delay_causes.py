"""Delays: which of force, wheels and accelerometer being late explains both equations."""

from dataclasses import replace
from typing import Final

import numpy as np

from analysis.findings.altered_motion import delay_channel
from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.likelihood_search import NO_FAULTS, PickedCause, search_likelihood
from analysis.findings.long_delays import LongDelay, long_delay
from analysis.findings.refit import refit_mended

#: which is this.
EXPLAINED_BY_LONG: Final = (
    *("sign_flipped", "unsigned", "wrong_unit", "wrong_scale", "unlike_sides", "frozen"),
    *("imu_misaligned", "imu_bias", "slope", "offset", "imu_low_passed", "wheel_radius", "slip"),
    *("coulomb", "driveline", "gain_drift", "braking_inside", "braking_left_out", "resonance"),
    *("external_force", "load_changed_inside", "heteroscedastic", "coloured_residuals"),
    *("too_little_excitation", "collinear", "imu_loose", "spikes"),
)
_SHOWN: Final = {"force": "force", "speed": "speed", "imu": "accelerometer"}


def find_delays(inputs: FindingInputs) -> list[Symptom]:
    """The channels that are late, by the likelihood of f(t - d) = m a + b v with m, b refitted."""
    late = long_delay(inputs)
    if late is not None:
        return [_long_delay_symptom(inputs, late)]
    found = [pick for name, pick in search_likelihood(inputs).items() if name.startswith("delay")]
    return [_symptom(inputs, pick) for pick in found if not is_filter_delay(pick)]


def find_filter_delay(inputs: FindingInputs) -> list[Symptom]:
    """An accelerometer that is later than stamps are."""
    found = search_likelihood(inputs).get("delay:imu")
    if found is None or not is_filter_delay(found):
        return []
    return [replace(_symptom(inputs, found), alternatives=("delay",), setting=None, value=None)]


def is_long(cause: str, strength: float | None) -> bool:
    """Whether a finding is a delay that hides all else."""
    return cause == "delay" and strength is not None and strength >= LIMITS.long_delay_rank


def is_filter_delay(pick: PickedCause) -> bool:
    """Whether a delay is rather an accelerometer that a filter makes late."""
    return pick.name == "delay:imu" and pick.value > LIMITS.filter_delay_s


def _symptom(inputs: FindingInputs, pick: PickedCause) -> Symptom:
    channel = pick.name.partition(":")[2]
    late_s, std_s = pick.value, pick.std
    names = _delayed_channels(inputs, channel)
    setting, value = inputs.shift_channels(names, late_s)
    rivals = [each.partition(":")[2] for each in pick.rivals if each.startswith("delay")]
    words = "late" if late_s > 0 else "early"
    against = " and ".join(_SHOWN[each] for each in _SHOWN if each != channel)
    said = f"{abs(1e3 * late_s):.1f} ± {1e3 * std_s:.1f} ms {words} against {against}"
    if rivals:
        said += f"; as likely the {' or '.join(_SHOWN[each] for each in rivals)} is off"
    smooth = channel == "imu" and late_s > 0
    others = [n for n in pick.rivals if not n.startswith("delay") and n not in NO_FAULTS]
    # what is early against an accelerometer may be in time, and the accelerometer filtered
    filtered = smooth or (late_s < 0.0 and "imu" in rivals)
    return Symptom(
        min(
            float(np.sqrt(pick.gain)) / LIMITS.likelihood_gain_root,
            abs(late_s) / LIMITS.trusted_stamp_s,
        ),
        said,
        channel=next(iter(names), None),
        setting=setting if names else None,
        value=value if names else None,
        # a low-pass is not mended by a delay
        change=None
        if smooth
        else lambda: refit_mended(
            inputs,
            lambda motion: delay_channel(motion, channel, late_s),
            min(std_s / abs(late_s), 1.0),
        ),
        alternatives=(*others, *(("imu_low_passed",) if filtered else ())),
    )


def _long_delay_symptom(inputs: FindingInputs, late: LongDelay) -> Symptom:
    names = _delayed_channels(inputs, late.channel)
    setting, value = inputs.shift_channels(names, late.late_s)
    words = "late" if late.late_s > 0.0 else "early"
    rest = [late.rival] if late.rival else [each for each in _SHOWN if each != late.channel]
    against = " and ".join(_SHOWN[each] for each in rest)
    others = f"; as likely the {_SHOWN[late.rival]} is off" if late.rival else ""
    return Symptom(
        LIMITS.long_delay_rank,
        f"{abs(late.late_s):.2f} s {words} against {against}: so they correlate by "
        f"{late.correlation[0]:.2f}, as they are by {late.correlation[1]:.2f}{others}",
        channel=next(iter(names), None),
        setting=setting if names and not late.rival else None,
        value=value if names and not late.rival else None,
        # what is late may have been filtered
        alternatives=("imu_low_passed",) if late.channel == "imu" and late.late_s > 0.0 else (),
        explains=EXPLAINED_BY_LONG,
    )


def _delayed_channels(inputs: FindingInputs, name: str) -> tuple[str, ...]:
    if name == "force":
        return inputs.measured("force_x_N") or inputs.measured(
            "torque_left_N_m", "torque_right_N_m"
        )
    if name == "speed":
        return inputs.speed_channels
    return inputs.measured(ACC)
