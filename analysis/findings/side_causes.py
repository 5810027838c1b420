"""Sides that are unlike while the machine drives straight: one sensor, wheel or tyre is off."""

from typing import Final

import numpy as np

from analysis.diagnosis.side_comparison import SPEEDS, SURELY, TORQUES, SideDifference
from analysis.findings.cause import Change, Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS

_CHANNELS: Final = {"torque": TORQUES, "speed": SPEEDS, "slip": SPEEDS}


def find_unlike_sides(inputs: FindingInputs) -> list[Symptom]:
    """The largest difference between left and right."""
    found = [_symptom(inputs, each) for each in inputs.check_inputs.sides.values()]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _symptom(inputs: FindingInputs, seen: SideDifference) -> Symptom:
    least = LIMITS.unlike_slip_1 if seen.kind == "slip" else LIMITS.unlike_sides_1
    strength = abs(seen.value_1) / max(least + seen.resistance_1, SURELY * seen.std_1)
    left, right = _CHANNELS[seen.kind]
    smaller, larger = (left, right) if seen.smaller == "left" else (right, left)
    other = "right" if seen.smaller == "left" else "left"
    if seen.kind == "torque":
        return Symptom(
            strength,
            f"on straight drives the {seen.smaller} torque is {seen.share_1:.1%} "
            f"(± {seen.std_1:.1%}) of the {other} one: one of the two is wrong",
            channel=smaller,
            change=lambda: _if_smaller_is_wrong(inputs, seen),
        )
    if seen.kind == "slip":
        return Symptom(
            strength,
            f"in hard starts the {other} wheels turn faster than the {seen.smaller} ones by "
            f"{abs(seen.value_1):.1%} ± {seen.std_1:.1%} more than in soft ones, by the gyroscope",
            channel=larger,
            change=lambda: _no_change(inputs),
            alternatives=("slip",),
        )
    wrong = _wrong_speed(inputs, seen)
    setting, value = (None, None) if wrong is None else inputs.scale_channels((wrong[0],), wrong[1])
    by_imu = (
        "" if wrong is None else f"; the accelerometer agrees with the {_other_side(wrong[0])} ones"
    )
    return Symptom(
        strength,
        f"on straight drives the {other} wheels turn faster than the {seen.smaller} ones by "
        f"{abs(seen.value_1):.1%} ± {seen.std_1:.1%}, by the gyroscope{by_imu}",
        channel=larger if wrong is None else wrong[0],
        setting=setting,
        value=value,
        change=lambda: _no_change(inputs),
    )


def _other_side(channel: str) -> str:
    return "right" if channel == SPEEDS[0] else "left"


def _wrong_speed(inputs: FindingInputs, seen: SideDifference) -> tuple[str, float] | None:
    """The speed that the accelerometer contradicts, and what its scale is to be multiplied by."""
    wheels = None if inputs.fit is None else inputs.fit.kinematics
    if wheels is None or not wheels.is_consistent:
        return None
    gains = [(1.0 + wheels.gain[0]) * (1.0 + way * seen.value_1 / 2.0) for way in (-1.0, 1.0)]
    if min(gains) <= 0.0:
        return None
    off = np.abs(np.log(gains))
    right = int(np.argmin(off))
    if off[right] > LIMITS.right_side_1 or off[1 - right] < off[right] + LIMITS.wrong_side_1:
        return None
    return SPEEDS[1 - right], gains[right] / gains[1 - right]


def _if_smaller_is_wrong(inputs: FindingInputs, seen: SideDifference) -> Change | None:
    """If the larger one is wrong, the mass is as much too large as it is else too small."""
    if inputs.fit is None or seen.share_1 <= -1.0:
        return None
    kg = abs(inputs.fit.mass_kg) * (2.0 / (1.0 + max(seen.share_1, 0.0)) - 1.0)
    return Change(kg, kg)


def _no_change(inputs: FindingInputs) -> Change | None:
    """The accelerometer weighs: what the wheels say hardly moves the mass."""
    fit = inputs.fit
    return None if fit is None or not fit.motion.by_accelerometer else Change(0.0, 0.5 * fit.u_kg)
