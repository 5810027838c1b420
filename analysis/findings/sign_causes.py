"""Causes in a channel's sign, side, unit or scale."""

from dataclasses import replace
from typing import Final

import numpy as np

from analysis.findings.accelerometer_response import (
    PitchCorrection,
    find_pitch_correction,
    fit_imu_to_wheel_acceleration_gain_and_std,
    may_noise_lower_imu_gain_from_1,
)
from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import ACC, ACCELERATIONS, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.refit import (
    compute_mass_change_by_refit,
    compute_mass_change_by_refit_with_answer_u,
)
from analysis.findings.unsigned_channels import find_unsigned_speed, has_channel_lost_its_sign
from analysis.model.schema import get_column_values
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.motion_samples import MotionSamples
from estimators.arrays import Floats

#: Mistakes of speed units, by the ratio of the units.
_SPEED_UNITS: Final = {
    3.6: "km/h read as m/s",
    1.0 / 0.44704: "mile/h read as m/s",
    1.609344: "km/h read as mile/h",
    1.0 / 1.609344: "mile/h read as km/h",
    1.0 / 0.3048: "ft/s read as m/s",
    1000.0: "mm/s read as m/s",
    9.5493: "rpm read as rad/s",
    57.2958: "degrees/s read as rad/s",
}
#: Mistakes of wheel speed units, by the ratio over the wheel radius.
_WHEEL_UNITS: Final = {
    1.0: "rad/s read as m/s",
    9.5493: "rpm read as m/s",
    57.2958: "degrees/s read as m/s",
}
_ACC_AXES: Final = (ACC, "specific_force_y_m_s2", "specific_force_z_m_s2")
_ACC_UNITS: Final = {1.0 / 9.80665: "g read as m/s²", 1000.0: "mm/s² read as m/s²"}
_FORCE_UNITS: Final = {
    1000.0: "mN read as N",
    1e-3: "kN read as N",
    1.0 / 4.4482216: "lbf read as N",
    1.0 / 9.80665: "kgf read as N",
    8.8507: "lbf·in read as N·m",
}


def find_flipped_sign(inputs: FindingInputs) -> list[Symptom]:
    """Find a channel or side whose sign contradicts the others."""
    pitch = find_pitch_correction(inputs)
    if pitch is not None:  # whatever else then contradicts the accelerometer
        return [make_pitch_symptom(inputs, pitch)] if pitch.factor == -1.0 else []
    found = [*_find_flipped_axis(inputs), *_find_flipped_side(inputs)]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _find_flipped_axis(inputs: FindingInputs) -> list[Symptom]:
    """Find a force, speed or accelerometer of the opposite sign."""
    of_force = inputs.value_by_check.get("force_sign", np.nan)
    driving_share = inputs.value_by_check.get("driving_share", np.nan)
    gain, std = fit_imu_to_wheel_acceleration_gain_and_std(inputs) or (np.nan, np.nan)
    by_imu = abs(gain) > LIMITS.signed_gain_std * std
    if not np.isfinite(of_force):
        return []
    names: tuple[str, ...] = ()
    if of_force < -LIMITS.signed_correlation and not (by_imu and gain < 0.0):
        names = inputs.select_measured_channels("force_x_N") or inputs.select_measured_channels(
            "torque_left_N_m", "torque_right_N_m"
        )
    elif by_imu and gain < 0.0:
        names = (
            inputs.select_measured_channels(ACC)
            if of_force < -LIMITS.signed_correlation
            else inputs.speed_channels
        )
    elif (
        driving_share < LIMITS.opposed_driving_share
        and of_force > LIMITS.signed_correlation
        and not by_imu
        and inputs.select_measured_channels(*ACCELERATIONS)
    ):
        # every start seems to go against the force; a derived acceleration would flip as well
        names = inputs.speed_channels
    # a speed that has lost its sign makes drives in reverse look like a wrong sign
    if not names or find_unsigned_speed(inputs):
        return []
    setting, value = inputs.propose_scale_settings(names, -1.0)
    contradiction = of_force if of_force < -LIMITS.signed_correlation or not by_imu else gain
    strength = max(abs(contradiction) / LIMITS.signed_correlation, 1.0)
    return [
        Symptom(
            10.0 * strength,
            f"force and acceleration have a partial correlation of {of_force:+.2f}, given the speed"
            + (f", the accelerometer reads {gain:+.2f} of the wheels'" if by_imu else "")
            + (
                f", and the force drives in {driving_share:.0%} of the starts"
                if driving_share < LIMITS.opposed_driving_share
                else ""
            ),
            channel=names[0],
            setting=setting,
            value=value,
            change=lambda: compute_mass_change_by_refit_with_answer_u(
                inputs, lambda motion: scale_channel_of_motion(motion, names[0], -1.0), 0.05
            ),
        )
    ]


def _find_flipped_side(inputs: FindingInputs) -> list[Symptom]:
    """Find left and right torques that oppose each other in straight driving."""
    sides = inputs.select_measured_channels("torque_left_N_m", "torque_right_N_m")
    if len(sides) < 2:
        return []
    left, right = (get_column_values(inputs.aligned, name) for name in sides)
    used = inputs.check_inputs.mark_samples_in_phases("accelerating", "cruising", "braking")
    used &= np.isfinite(left) & np.isfinite(right)
    if (
        used.sum() < 200
        or not (used & inputs.check_inputs.mark_samples_in_phases("accelerating")).any()
    ):
        return []
    together = float(np.corrcoef(left[used], right[used])[0, 1])
    if together > LIMITS.opposing_sides_correlation or any(
        has_channel_lost_its_sign(inputs, name) for name in sides
    ):
        return []
    along = inputs.check_inputs.straight_motion.speed_or_yaw_rate
    speeding = used & inputs.check_inputs.mark_samples_in_phases("accelerating")
    wrong = sides[
        int(np.argmin([float((each * np.sign(along))[speeding].mean()) for each in (left, right)]))
    ]
    setting, value = inputs.propose_scale_settings((wrong,), -1.0)
    return [
        Symptom(
            LIMITS.sign_rank * abs(together),
            f"left and right torque have a correlation of {together:+.2f} in straight driving",
            channel=wrong,
            setting=setting,
            value=value,
        )
    ]


def make_pitch_symptom(inputs: FindingInputs, pitch: PitchCorrection) -> Symptom:
    """Propose the factor of a pitch that contradicts accelerometer and wheels."""
    setting, value = inputs.propose_scale_settings(("pitch_rad",), pitch.factor)
    reading = " and ".join(
        ["in degrees"] * (abs(pitch.factor) < 1.0) + ["of opposite sign"] * (pitch.factor < 0.0)
    )
    return Symptom(
        LIMITS.sign_rank,
        f"if the pitch is {reading}, it explains all but {pitch.left_1:.1%} of the mean square "
        "difference between accelerometer and wheels",
        channel="pitch_rad",
        setting=setting,
        value=value,
    )


def find_swapped_sides(inputs: FindingInputs) -> list[Symptom]:
    """Find wheel speeds whose turning direction contradicts the gyroscope."""
    gyro = "yaw_rate_rad_s"
    sides = inputs.select_measured_channels("speed_left_m_s", "speed_right_m_s")
    width = inputs.machine.machine.track_width_m
    if len(sides) < 2 or gyro not in inputs.aligned.columns or width is None:
        return []
    left, right, rate = (get_column_values(inputs.aligned, name) for name in (*sides, gyro))
    turns = (right - left) / width
    used = np.isfinite(turns) & np.isfinite(rate) & ~inputs.is_standing_sample
    if used.sum() < 200:
        return []
    step = count_rows_in_duration(LIMITS.independent_rows_s, inputs.machine.settings.align.rate_hz)
    x, y = rate[used][::step], turns[used][::step]
    if float(np.sqrt((x**2).mean())) < LIMITS.turn_rad_s or not y.any():
        return []
    together = float(x @ y) / float(np.sqrt((x @ x) * (y @ y)))
    if together > -LIMITS.signed_correlation:
        return []
    torques = inputs.select_measured_channels("torque_left_N_m", "torque_right_N_m")
    names = (*sides, *torques)
    channels = inputs.machine.channels
    pairs = [(names[i], names[i ^ 1]) for i in range(len(names))]
    keys = ", ".join(f"channels.{name}.field" for name, _ in pairs)
    fields = ", ".join(f'"{channels[other].field}"' for _, other in pairs)
    return [
        Symptom(
            10.0 * abs(together) / LIMITS.signed_correlation,
            f"the yaw rate from the wheels has a correlation of {together:+.2f} with the "
            "gyroscope's",
            channel=sides[0],
            setting=keys,
            value=fields,
            # straight motion does not depend on the assignment of the sides
            change=lambda: compute_mass_change_by_refit(inputs, lambda motion: motion),
            alternatives=("sign_flipped",),
        )
    ]


def find_wrong_channel_unit(inputs: FindingInputs) -> list[Symptom]:
    """Find ratios of speed, acceleration and force that match a common unit conversion."""
    pitch = find_pitch_correction(inputs)
    if pitch is not None:
        return [] if pitch.factor == -1.0 else [make_pitch_symptom(inputs, pitch)]
    # a mass off by a unit ratio may be due to the unit of the acceleration
    found = (
        _find_wrong_unit_by_gravity(inputs)
        or _find_wrong_unit_by_speed(inputs)
        or _find_wrong_unit_by_empty_mass(inputs)
    )
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _find_wrong_unit_by_gravity(inputs: FindingInputs) -> list[Symptom]:
    """Compare the accelerometer's z axis at standstill with gravity."""
    names = inputs.select_measured_channels(*_ACC_AXES)
    reads, _ = inputs.compute_mean_and_std_of_column_at_rest(_ACC_AXES[2])
    share = reads / inputs.machine.machine.gravity_m_s2
    near = [
        r
        for r in _ACC_UNITS
        if share > 0.0 and abs(np.log(share / r)) < LIMITS.unit_ratio_tolerance
    ]
    if not near or ACC not in names:
        return []
    setting, value = inputs.propose_scale_settings(names, 1.0 / near[0])
    return [
        Symptom(
            10.0 * abs(float(np.log(share))) / LIMITS.signed_correlation,
            f"at standstill the accelerometer reads {reads:.4g} m/s² of gravity along z: "
            f"{_ACC_UNITS[near[0]]}",
            channel=ACC,
            setting=setting,
            value=value,
            change=lambda: compute_mass_change_by_refit_with_answer_u(
                inputs, lambda motion: scale_channel_of_motion(motion, ACC, 1.0 / near[0]), 0.05
            ),
        )
    ]


def _does_z_axis_read_gravity(inputs: FindingInputs) -> bool:
    """Whether the z axis reads ±g at rest, so that its unit is m/s²."""
    reads, _ = inputs.compute_mean_and_std_of_column_at_rest(_ACC_AXES[2])
    return bool(
        abs(abs(reads) / inputs.machine.machine.gravity_m_s2 - 1.0) < LIMITS.unit_ratio_tolerance
    )


def list_unit_mistakes_by_ratio(inputs: FindingInputs) -> dict[float, str]:
    """Names of wrong units by the ratio of accelerometer to wheels that each would cause."""
    found = {1.0 / times: what for times, what in _SPEED_UNITS.items()}
    radius_m = inputs.machine.machine.wheel_radius_m
    if radius_m is None:
        return found
    return {**{radius_m / times: what for times, what in _WHEEL_UNITS.items()}, **found}


def _find_wrong_unit_by_speed(inputs: FindingInputs) -> list[Symptom]:
    """Compare the accelerometer with the wheels and with gravity."""
    gain = inputs.value_by_check.get("acceleration_gain", np.nan)
    seen = fit_imu_to_wheel_acceleration_gain_and_std(inputs)
    # with little motion the gain is arbitrary
    if not gain > 0.0 or seen is None or not seen[1] < LIMITS.known_ratio_u * abs(seen[0]):
        return []
    units = list_unit_mistakes_by_ratio(inputs)
    channels = dict.fromkeys(units, inputs.speed_channels)
    if not _does_z_axis_read_gravity(inputs):
        channels |= dict.fromkeys(_ACC_UNITS, inputs.select_measured_channels(*_ACC_AXES))
    near = {
        ratio: abs(float(np.log(gain / ratio)))
        for ratio, names in channels.items()
        # with a wheel radius of about a metre, rad/s and m/s are indistinguishable
        if names and abs(np.log(ratio)) > 2.0 * LIMITS.unit_ratio_tolerance
    }
    ratio = min(near, key=near.__getitem__, default=None)
    if ratio is None or near[ratio] > LIMITS.unit_ratio_tolerance:
        return []
    if may_noise_lower_imu_gain_from_1(inputs):  # and the ratio is near by chance
        return []
    alike = [
        r
        for r in near
        if near[r] < near[ratio] + max(LIMITS.ratio_resolution, 3.0 * seen[1] / seen[0])
    ]
    names = channels[ratio]
    # the factor for the accelerometer's scale, or its inverse for the wheels'
    times = 1.0 / ratio if names[0] == ACC else ratio
    setting, value = inputs.propose_scale_settings(names, times)
    is_unique = all(channels[each] == names for each in alike)
    what = " or ".join(
        {**units, **_ACC_UNITS}[each] for each in sorted(alike, key=near.__getitem__)
    )
    return [
        Symptom(
            10.0 * abs(float(np.log(gain))) / LIMITS.signed_correlation,
            f"accelerometer over wheels is {gain:.4g}, near {ratio:.4g}: {what}",
            channel=names[0],
            setting=setting if is_unique else None,
            value=value if is_unique else None,
            change=lambda: compute_mass_change_by_refit_with_answer_u(
                inputs, lambda motion: scale_channel_of_motion(motion, names[0], times), 0.05
            ),
        )
    ]


def _find_wrong_unit_by_empty_mass(inputs: FindingInputs) -> list[Symptom]:
    """Compare the mass with that of the empty machine."""
    ratio = inputs.value_by_check.get("empty_mass_ratio", np.nan)
    empty_kg = inputs.machine.machine.empty_mass_kg
    fit = inputs.fit_without_learnt_priors
    if fit is not None and empty_kg and fit.mass_kg > 0:
        ratio = fit.mass_kg / empty_kg
    names = inputs.select_measured_channels("force_x_N") or inputs.select_measured_channels(
        "torque_left_N_m", "torque_right_N_m"
    )
    if fit is None:
        poor = not inputs.value_by_check.get("relative_std", np.inf) < LIMITS.known_ratio_u
    else:
        # with the full uncertainty of the mass: a lag far beyond its prior allows any ratio
        poor = not inputs.value_by_check.get("relative_u", np.inf) < LIMITS.known_mass_u
    if not np.isfinite(ratio) or ratio <= 0.0 or poor or not names:
        return []
    near = min(_FORCE_UNITS, key=lambda times: abs(np.log(ratio / times)))
    if abs(np.log(ratio / near)) > LIMITS.unit_mass_tolerance or abs(np.log(ratio)) < 3.0 * abs(
        np.log(ratio / near)
    ):
        return []
    setting, value = inputs.propose_scale_settings(names, 1.0 / near)
    return [
        Symptom(
            10.0 * abs(float(np.log(ratio))) / LIMITS.signed_correlation,
            f"the mass is {ratio:.3g} times that of the empty machine: {_FORCE_UNITS[near]}",
            channel=names[0],
            setting=setting,
            value=value,
            change=lambda: compute_mass_change_by_refit_with_answer_u(
                inputs, lambda motion: scale_channel_of_motion(motion, names[0], 1.0 / near), 0.05
            ),
        )
    ]


def scale_channel_of_motion(motion: MotionSamples, channel: str, factor: float) -> MotionSamples:
    """The motion with one channel multiplied by a factor."""
    if channel == ACC:

        def multiply_if_known(x: Floats | None) -> Floats | None:
            return None if x is None else x * factor

        return replace(
            motion,
            acceleration=motion.acceleration * factor,
            specific_force=multiply_if_known(motion.specific_force),
            without_gravity=multiply_if_known(motion.without_gravity),
        )
    if channel.startswith(("speed", "position")):
        turned = np.sign(factor)
        return replace(motion, speed=motion.speed * factor, direction=motion.direction * turned)
    return replace(motion, force=motion.force * factor)


def find_lightest_load_off_empty_mass(inputs: FindingInputs) -> list[Symptom]:
    """Find a lightest load whose mass contradicts the empty mass, given the scale's uncertainty."""
    found = inputs.check_inputs.empty_mass_difference
    if found is None or not found.can_test_scale:
        return []
    return [
        Symptom(
            abs(found.difference_over_uncertainty) / LIMITS.wrong_scale_u,
            found.difference_and_causes_text,
            channel=inputs.force_channel,
        )
    ]
