"""Causes in the accelerometer: tilt, bias, misalignment, low-pass, lost gravity, a loose mount.

An IMU that rocks on its mount rings after each start, while the force does not. If the motion is
slow compared with the mount's natural frequency, it only looks like a wrong accelerometer scale: x
grows by gravity times the angle by which the acceleration tilts the IMU.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from analysis.findings.accelerometer_response import (
    compute_imu_spectra_after_starts_and_at_rest,
    fit_imu_to_boom_angle_slope_and_std,
    fit_imu_to_wheel_acceleration_gain_and_std,
)
from analysis.findings.altered_motion import transform_accelerometer_signals
from analysis.findings.cause import Symptom
from analysis.findings.constant_forces import (
    compute_gravity_by_pitch_m_s2,
    explain_constant_force,
    has_pitch_channel,
)
from analysis.findings.delay_causes import find_accelerometer_filter_delay
from analysis.findings.finding_inputs import ACC, SPEEDS, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.refit import compute_mass_change_by_refit
from analysis.findings.sampling_causes import measure_repeat_fraction_and_resolution
from analysis.model.physical_units import find_gain_and_offset_to_si
from analysis.model.schema import get_column_values
from analysis.model.windows import list_whole_blocks_of_runs
from analysis.stages.motion.forces import compute_longitudinal_force
from analysis.stages.motion.phases import average_acceleration_over_rate_span
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.motion_samples import MotionSamples

#: Ratios of common units, which the cause `wrong_unit` reports instead.
_UNITS: Final = (1.0 / 9.80665, 1.0 / 3.6, 1.0 / 1000.0, 0.3048)

_PITCH: Final = "pitch_rad"
_Y: Final = "specific_force_y_m_s2"
_Z: Final = "specific_force_z_m_s2"
#: Channels that must be measured so that a rotated IMU can be corrected.
_ALL_AXES: Final = (ACC, _Y, _Z, "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")


def does_accelerometer_lack_gravity(inputs: FindingInputs) -> bool:
    """Whether the accelerometer reads no gravity along z at standstill."""
    z, _ = inputs.compute_mean_and_std_of_column_at_rest(_Z)
    return bool(abs(z) < LIMITS.gravity_min_fraction * inputs.machine.machine.gravity_m_s2)


def find_tilted_accelerometer(inputs: FindingInputs) -> list[Symptom]:
    """Find a tilted or turned accelerometer: gravity along x at rest, or driving along y."""
    over = _find_upside_down_mounting(inputs)
    if over:
        return over
    upright = _find_accelerometer_error_at_rest(inputs, ("tilt", ""))
    found = [*upright, *_find_mounting_yaw(inputs)]
    return [max(found, key=lambda sign: sign.strength)] if found else []


def _find_upside_down_mounting(inputs: FindingInputs) -> list[Symptom]:
    """Find an accelerometer mounted upside down, by gravity of the wrong sign along z."""
    z, std = inputs.compute_mean_and_std_of_column_at_rest(_Z)
    pull = inputs.machine.machine.gravity_m_s2
    if not z < -LIMITS.gravity_min_fraction * pull or not inputs.select_measured_channels(_Z):
        return []
    seen = fit_imu_to_wheel_acceleration_gain_and_std(inputs)
    backwards = seen is not None and seen[0] < -LIMITS.low_passed_std * seen[1]
    angle = "pitch_deg" if backwards else "roll_deg"
    whole = len(inputs.select_measured_channels(*_ALL_AXES)) == len(_ALL_AXES)
    turned = (ACC, "roll_rate_rad_s") if backwards else (_Y, "pitch_rate_rad_s")
    keys, scales = inputs.propose_scale_settings(
        inputs.select_measured_channels(_Z, *turned, "yaw_rate_rad_s"), -1.0
    )
    stated = getattr(inputs.machine.machine.imu, angle)
    kind = "pitch" if backwards else "roll"
    return [
        Symptom(
            LIMITS.upside_down_rank * abs(z) / pull,
            f"at standstill the accelerometer reads {z:+.2f} ± {std:.2f} m/s² along z, where an "
            f"upright one would read {pull:+.2f}: it is mounted upside down (180° of {kind})",
            channel=_Z,
            setting=f"machine.imu.{angle}" if whole else keys,
            value=f"{stated + 180.0 if stated <= 0.0 else stated - 180.0:g}" if whole else scales,
            change=None
            if backwards
            else lambda: compute_mass_change_by_refit(inputs, lambda motion: motion),
        )
    ]


def find_accelerometer_bias(inputs: FindingInputs) -> list[Symptom]:
    """Find a reading along x at standstill while the z axis reads all of gravity."""
    return _find_accelerometer_error_at_rest(inputs, ("bias",))


def _find_accelerometer_error_at_rest(
    inputs: FindingInputs, candidate_causes: tuple[str, ...]
) -> list[Symptom]:
    """Symptom of a wrong accelerometer reading at rest."""
    seen = explain_constant_force(inputs)
    error, std = seen.error_m_s2
    if not np.isfinite(error) or seen.tilt is False or does_accelerometer_lack_gravity(inputs):
        return []
    kind = classify_rest_error_as_tilt_or_bias(inputs, error)
    if kind not in candidate_causes:
        return []
    # a tilt appears as a constant force, sloping ground does not
    others = () if kind else ("imu_bias",)
    if not (seen.tilt or has_pitch_channel(inputs)):
        others = (*others, "slope")
    names = inputs.select_measured_channels(ACC)
    degrees = np.degrees(np.arcsin(np.clip(error / inputs.machine.machine.gravity_m_s2, -1.0, 1.0)))
    said = {"": "nose-up, or a bias", "tilt": "nose-up", "bias": "if this were a tilt"}[kind]
    offset = inputs.machine.channels[ACC].offset if names else 0.0
    return [
        Symptom(
            float(
                abs(error) / max(LIMITS.standing_reading_std * std, LIMITS.standing_reading_m_s2)
            ),
            f"at standstill the accelerometer reads {error:+.4f} ± {std:.4f} m/s² along x beyond "
            f"gravity: {degrees:+.2f}° {said}",
            channel=ACC,
            setting=f"channels.{ACC}.offset" if names else None,
            value=f"{offset - convert_to_accelerometer_unit(inputs, error):.5g}" if names else None,
            change=lambda: compute_mass_change_by_refit(
                inputs,
                lambda motion: transform_accelerometer_signals(motion, lambda x: x - error),
                min(std / abs(error), 1.0),
            ),
            alternatives=others,
        )
    ]


def classify_rest_error_as_tilt_or_bias(inputs: FindingInputs, error_m_s2: float) -> str:
    """Distinguish a tilt from a bias by the z axis: a tilt reduces the gravity that z reads.

    Returns:
        "tilt", "bias", or "" if the log cannot distinguish them.
    """
    z, _ = inputs.compute_mean_and_std_of_column_at_rest(_Z)
    pull = inputs.machine.machine.gravity_m_s2
    if not np.isfinite(z) or not has_pitch_channel(inputs) or abs(error_m_s2) >= pull:
        return ""
    pitch = inputs.compute_mean_and_std_of_column_at_rest(_PITCH)[0]
    share = np.arcsin(error_m_s2 / pull)
    upright, turned = pull * np.cos(pitch), pull * np.cos(pitch + share)
    if upright - turned < LIMITS.tilt_min_gravity_m_s2:
        return ""
    return "tilt" if abs(z - turned) < abs(z - upright) else "bias"


def _find_mounting_yaw(inputs: FindingInputs) -> list[Symptom]:
    if (
        _Y not in inputs.check_inputs.excitation.columns
        or ACC not in inputs.check_inputs.excitation.columns
    ):
        return []
    settings = inputs.machine.settings
    rate = get_column_values(inputs.check_inputs.excitation, "speed_rate_x_m_s2")
    ahead, left = (
        average_acceleration_over_rate_span(
            get_column_values(inputs.check_inputs.excitation, name), settings
        )
        for name in (ACC, _Y)
    )
    used = inputs.check_inputs.mark_samples_in_phases("accelerating", "braking", "cruising")
    used &= np.isfinite(rate) & np.isfinite(ahead) & np.isfinite(left)
    if used.sum() < 200:
        return []
    step = count_rows_in_duration(LIMITS.independent_rows_s, settings.align.rate_hz)
    x, a, y = (each[used][::step] for each in (rate, ahead, left))
    x, a, y = x - x.mean(), a - a.mean(), y - y.mean()
    power = float(x @ x)
    if power == 0.0:
        return []
    along, across = float(x @ a) / power, float(x @ y) / power
    std = float(np.sqrt(((y - across * x) ** 2).sum() / max(x.size - 2, 1) / power))
    if along <= 0.0:
        return []
    angle = float(np.arctan2(across, along))
    # noise of the wheel acceleration reduces both components, but not the error of the angle
    std /= float(np.hypot(along, across))
    strength = abs(angle) / max(LIMITS.standing_reading_std * std, LIMITS.misalignment_min_yaw_rad)
    if len(inputs.select_measured_channels(*_ALL_AXES)) == len(_ALL_AXES):
        setting = "machine.imu.yaw_deg"
        value = f"{inputs.machine.machine.imu.yaw_deg - np.degrees(angle):.2f}"
    else:
        # a machine that drives straight shows only the component along x
        setting, value = inputs.propose_scale_settings(
            inputs.select_measured_channels(ACC), 1.0 / float(np.cos(angle))
        )
    return [
        Symptom(
            strength,
            f"while the wheels speed up, the measured acceleration points {np.degrees(angle):+.1f} "
            f"± {np.degrees(std):.1f}° off the forward axis",
            channel=_Y,
            setting=setting,
            value=value,
            change=lambda: compute_mass_change_by_refit(
                inputs,
                lambda motion: transform_accelerometer_signals(motion, lambda x: x / np.cos(angle)),
                min(2.0 * std / abs(angle), 1.0),
            ),
        )
    ]


def find_low_passed_accelerometer(inputs: FindingInputs) -> list[Symptom]:
    """Find an accelerometer that measures only a fraction of the wheels' acceleration."""
    if not inputs.has_accelerometer:
        return []
    late, found = (
        find_accelerometer_filter_delay(inputs),
        fit_imu_to_wheel_acceleration_gain_and_std(inputs),
    )
    if found is None:
        return late
    gain, std = found
    if gain + LIMITS.low_passed_std * std < -LIMITS.low_passed_gain_1 / 2.0:
        return late
    if std < LIMITS.unit_gain_std_1 and any(abs(gain / unit - 1.0) < 0.06 for unit in _UNITS):
        return late
    seen = [
        Symptom(
            (LIMITS.low_passed_gain_1 - gain) / (LIMITS.low_passed_std * std),
            f"the accelerometer reads {gain:.2f} ± {std:.2f} of the wheels' acceleration",
            channel=ACC,
            alternatives=("delay",) if gain > LIMITS.low_passed_gain_1 - 0.1 else (),
        )
    ]
    return [max((*seen, *late), key=lambda sign: sign.strength)]


def find_slope_missing_from_acceleration(inputs: FindingInputs) -> list[Symptom]:
    """Find sloping ground whose gravity the acceleration does not include."""
    return _find_descents_without_pitch(inputs) or _find_slope_under_gravity_free_acceleration(
        inputs
    )


def _find_descents_without_pitch(inputs: FindingInputs) -> list[Symptom]:
    """Find an idle drive whose machine does not slow down, in a log of speeds alone."""
    if inputs.machine.settings.forces.acceleration != "kinematic" or has_pitch_channel(inputs):
        return []
    force = compute_longitudinal_force(inputs.aligned, inputs.machine.machine)
    speed = get_column_values(inputs.aligned, "speed_x_m_s")
    changes_m_s = np.diff(speed, 2)
    if not (np.isfinite(force).any() and np.isfinite(changes_m_s).any()):
        return []
    rest_N, _ = inputs.compute_mean_and_std_of_signal_at_rest(force)
    # an offset of the sensor may hide the force of a cruise
    along = np.sign(speed) * force + abs(np.nan_to_num(rest_N))
    idle = (along < inputs.idle_force_newtons) & ~inputs.is_standing_sample
    rate_hz = inputs.machine.settings.align.rate_hz
    end = max(1, round(LIMITS.descent_end_s * rate_hz))
    noise_m_s = float(np.nanmedian(np.abs(changes_m_s))) / np.sqrt(6.0 * end)
    for name in inputs.select_measured_channels(*SPEEDS):
        noise_m_s += measure_repeat_fraction_and_resolution(inputs, name)[1]
    # on level ground the least rolling resistance takes off more than noise
    slowed_s = LIMITS.descent_noise_factor * noise_m_s / LIMITS.least_rolling_m_s2
    window = max(2 * end, round(max(LIMITS.descent_window_s, slowed_s) * rate_hz))
    undriven_N = LIMITS.descent_force_fraction * inputs.largest_force_newtons
    samples = 0
    for rows in list_whole_blocks_of_runs(idle, window):
        size = np.abs(speed[rows])
        holds = size[-end:].mean() - size[:end].mean() >= 0.0
        if holds and along[rows].mean() < undriven_N:
            samples += window
    held_s = samples / rate_hz
    return [
        Symptom(
            held_s / LIMITS.descent_min_s,
            f"without drive the machine held or gained speed for {held_s:.0f} s, as when it drives "
            "downhill: a pitch channel, or an accelerometer that includes gravity, would show it",
            alternatives=("external_force",),
        )
    ]


def _find_slope_under_gravity_free_acceleration(inputs: FindingInputs) -> list[Symptom]:
    """Find sloping ground in a log whose acceleration has gravity removed."""
    if (
        inputs.machine.settings.forces.acceleration == "kinematic"
        or not inputs.select_measured_channels(ACC)
        or not does_accelerometer_lack_gravity(inputs)
    ):
        return []
    z, _ = inputs.compute_mean_and_std_of_column_at_rest(_Z)
    keys, new = inputs.propose_kinematic_acceleration_settings()
    if not has_pitch_channel(inputs):
        lacking_1 = 1.0 - abs(z) / inputs.machine.machine.gravity_m_s2
        return [
            Symptom(
                lacking_1 / (1.0 - LIMITS.gravity_min_fraction),
                f"at standstill the accelerometer reads {z:.2f} m/s² along z: gravity has been "
                "removed, and no pitch shows the slopes",
                channel=ACC,
                setting=keys,
                value=new,
            )
        ]
    pitch, std = inputs.compute_mean_and_std_of_column_at_rest(_PITCH)
    if not np.isfinite(pitch):
        return []
    strength = abs(pitch) / max(LIMITS.standing_reading_std * std, LIMITS.slope_min_pitch_rad)
    pull = compute_gravity_by_pitch_m_s2(inputs)

    def add_gravity(motion: MotionSamples) -> MotionSamples:
        return replace(
            motion,
            acceleration=motion.acceleration + pull,
            specific_force=None if motion.specific_force is None else motion.specific_force + pull,
            without_gravity=motion.specific_force,
        )

    return [
        Symptom(
            strength,
            f"at standstill with a pitch of {np.degrees(pitch):+.2f} ± {np.degrees(std):.2f}° the "
            f"accelerometer reads {z:.2f} m/s² of gravity along z: gravity has been removed",
            channel=ACC,
            setting=keys,
            value=new,
            change=lambda: compute_mass_change_by_refit(
                inputs, add_gravity, min(std / abs(pitch), 1.0)
            ),
        )
    ]


def convert_to_accelerometer_unit(inputs: FindingInputs, acceleration_m_s2: float) -> float:
    """Convert an acceleration from m/s² to the unit of its channel."""
    channel = inputs.machine.channels[ACC]
    if channel.unit is None:
        return acceleration_m_s2
    return acceleration_m_s2 / find_gain_and_offset_to_si(channel.unit, "m/s²")[0]


def find_imu_on_boom(inputs: FindingInputs) -> list[Symptom]:
    """Find an IMU that turns with the boom, by gravity along x that follows the boom's angle."""
    found = fit_imu_to_boom_angle_slope_and_std(inputs)
    if found is None:
        return []
    slope, std = found
    limit = LIMITS.boom_gravity_fraction_per_rad * inputs.machine.machine.gravity_m_s2
    return [
        Symptom(
            abs(slope) / max(LIMITS.standing_reading_std * std, limit),
            f"at standstill the accelerometer's reading along x changes by {slope:+.2f} ± "
            f"{std:.2f} m/s² per rad of the boom's angle: the IMU turns with the boom. Mount it on "
            "the frame, or derive the acceleration from the speed (channels.acc_x_m_s2.derive = "
            '"d/dt speed_x_m_s" and settings.forces.acceleration = "kinematic")',
            channel=ACC,
        )
    ]


def find_loose_imu(inputs: FindingInputs) -> list[Symptom]:
    """Find an IMU that rocks on its mount, by a resonance after starts that the force lacks."""
    share = fit_imu_to_wheel_acceleration_gain_and_std(inputs)
    # a swinging frame rings too, but still reads the acceleration of the wheels
    if share is None or share[0] - LIMITS.loose_gain_std * share[1] < LIMITS.loose_gain_1:
        return []
    spectra = compute_imu_spectra_after_starts_and_at_rest(inputs)
    if spectra is None:
        return []
    hz, starts, standing, count = spectra
    floor = float(np.median(standing))
    smooth = starts.copy()
    smooth[1:-1] = (starts[:-2] + 2.0 * starts[1:-1] + starts[2:]) / 4.0
    best, at = 0.0, 0
    for k in np.flatnonzero((hz >= LIMITS.rocking_band_hz[0]) & (hz <= LIMITS.rocking_band_hz[1])):
        below, above = (
            max(float(np.median(starts[(hz >= low * hz[k]) & (hz <= high * hz[k])])), floor)
            for low, high in (LIMITS.below_peak_band, LIMITS.above_peak_band)
        )
        peak = float(smooth[k]) / float(np.sqrt(below * above)) / LIMITS.rocking_peak_ratio
        own = float(starts[k]) / max(float(standing[k]), 1e-12) / LIMITS.peak_over_standing_ratio
        if min(peak, own) > best:
            best, at = min(peak, own), int(k)
    return [
        Symptom(
            best,
            f"the accelerometer reads {share[0]:.2f} of the wheels' acceleration, and in the "
            f"first second of {count} starts it rings at {hz[at]:.1f} Hz, with "
            f"{np.sqrt(LIMITS.rocking_peak_ratio * best):.1f} times the amplitude of the "
            "neighbouring frequencies; the force does not ring",
            channel=ACC,
            # in slow motion it looks like a wrong scale of the accelerometer
            alternatives=("resonance",),
        )
    ]
