"""The table of causes: a description of each, and what a log must contain to show it."""

from typing import Final

from analysis.findings import (
    accelerometer_causes,
    changing_loads,
    channel_causes,
    delay_causes,
    fit_causes,
    mass_drifts,
    residual_causes,
    sampling_causes,
    setting_causes,
    sign_causes,
    spikes,
    unexplained,
    unsigned_channels,
)
from analysis.findings.cause import Cause

#: Causes that the equation of motion seems to show if readings or stamps are wrong,
_OF_EQUATION: Final = (
    *("delay", "wheel_radius", "slip", "coulomb", "too_little_excitation", "collinear"),
    *("load_changed_inside", "external_force", "braking_inside", "imu_low_passed"),
)
#: consequences of any misfit in its residuals; a resonance is none of them,
_OF_RESIDUALS: Final = ("coloured_residuals", "heteroscedastic", "driveline", "gain_by_speed")
#: and consequences of few usable starts.
_OF_FEW_STARTS: Final = ("too_little_excitation", "collinear")
_OF_FIT: Final = (*_OF_EQUATION, *_OF_RESIDUALS, "resonance")
_STILL: Final = "a standstill of three seconds"
_START: Final = "an informative manoeuvre"
_BOTH: Final = "an accelerometer in addition to the wheel speed"

CAUSES: Final = (
    Cause(
        "sign_flipped",
        "a channel, or one side of it, has the wrong sign",
        f"{_BOTH} to determine which channel; sloping ground for a pitch channel; a drive in which "
        "force and acceleration change",
        sign_causes.find_flipped_sign,
        withholds=True,
        explains=(
            *(*_OF_FIT, "unsigned", "offset", "wrong_unit", "imu_misaligned", "swapped_sides"),
            *("wrong_scale", "unlike_sides"),
        ),
        masks_others=True,
    ),
    Cause(
        "unsigned",
        "the force has lost its sign, as motor currents do, or the speed, as pulses do",
        "braking that the force sensor measures, or driving in reverse",
        unsigned_channels.find_unsigned_channel,
        withholds=True,
        explains=(
            *(*_OF_FIT, "offset", "wrong_unit", "wrong_scale", "unlike_sides"),
            *("imu_misaligned", "imu_bias", "imu_loose", "swapped_sides", "slope", "spikes"),
        ),
    ),
    Cause(
        "wrong_unit",
        "a channel is in another unit than the machine file states",
        f"{_BOTH}, or its z axis at standstill; sloping ground for a pitch channel; for the force "
        "the machine's empty mass",
        sign_causes.find_wrong_channel_unit,
        withholds=True,
        explains=(*_OF_FIT, "imu_misaligned", "offset", "slope", "wrong_scale"),
        masks_others=True,
    ),
    Cause(
        "wrong_scale",
        "all masses are wrong by one factor: a gear, a unit, the wheel radius or the measured "
        "wheels' share of the force",
        "the machine's empty mass, and a load that is lighter, too heavy for any payload, or known "
        "to be empty",
        sign_causes.find_lightest_load_off_empty_mass,
        withholds=True,
        withholds_only_if_check_fails=True,
    ),
    Cause(
        "swapped_sides",
        "left and right are swapped",
        "turns, a gyroscope and the speed of both sides",
        sign_causes.find_swapped_sides,
    ),
    Cause(
        "unlike_sides",
        "left and right differ in torque or speed: one sensor or one wheel is wrong",
        "straight drives with the torque of both sides, or with the speed of both and a gyroscope",
        channel_causes.find_largest_side_difference,
        withholds=True,
        withholds_only_if_check_fails=True,
        explains=(*_OF_FIT, "wrong_scale", "offset", "imu_misaligned"),
    ),
    Cause(
        "unmeasured_turns",
        "the machine turns, and no yaw rate tells curves from straight drives",
        "the speed of both sides, no yaw rate, and curves that need more force",
        channel_causes.find_turns_without_yaw_rate,
        explains=_OF_RESIDUALS,
    ),
    Cause(
        "frozen",
        "a channel repeats one reading while the machine moves",
        "another channel that changes meanwhile",
        channel_causes.find_frozen_channel,
        withholds=True,
        explains=(*_OF_FIT, "imu_misaligned", "spikes", "saturated", "wrong_scale", "unlike_sides"),
    ),
    Cause(
        "saturated",
        "readings are clipped at the limit of the sensor",
        "starts in which a reading reaches that limit",
        channel_causes.find_saturation,
        withholds=True,
        explains=(*_OF_FIT, "quantised", "wrong_unit", "wrong_scale", "unlike_sides"),
    ),
    Cause(
        "spikes",
        "single readings are spikes",
        "nothing more",
        spikes.find_spikes,
        explains=("load_changed_inside", "external_force", *_OF_RESIDUALS),
        max_explained_strength_ratio=2.0,
    ),
    Cause(
        "quantised",
        "the resolution of a channel is coarser than its noise",
        "motion",
        sampling_causes.find_coarse_channel_resolution,
        explains=(
            *(*_OF_RESIDUALS, "resonance"),
            *("delay", "wheel_radius", "slip", "frozen", "imu_low_passed"),
        ),
    ),
    Cause(
        "clock_jump",
        "header stamps of a topic jump against log time",
        "header stamps and log times",
        sampling_causes.find_header_clock_step,
        explains=("clock_drift", "delay", "irregular_sampling", "gaps", *_OF_RESIDUALS),
    ),
    Cause(
        "clock_drift",
        "the clocks of two topics drift apart",
        "header stamps and log times, of two topics",
        sampling_causes.find_header_clock_drift,
        explains=("delay", *_OF_RESIDUALS),
    ),
    Cause(
        "gaps", "samples of a topic are missing", "nothing more", sampling_causes.find_topic_gaps
    ),
    Cause(
        "repeated_rows",
        "the logger wrote a stretch twice",
        "a resolution finer than the noise, and a copy of two seconds and fifty rows",
        sampling_causes.find_copied_row_stretches,
        # excluded samples are a gap
        explains=("gaps", *_OF_FIT),
    ),
    Cause(
        "irregular_sampling",
        "a topic is sampled, or stamped, unevenly",
        "nothing more",
        sampling_causes.find_irregular_sampling,
        explains=("gaps", "spikes", "frozen", "clock_jump", "clock_drift", *_OF_FIT),
    ),
    Cause(
        "imu_misaligned",
        "gravity has a component along the forward axis, or the forward axis is not the driving "
        "direction",
        f"{_STILL}; the pitch, or a drive, to distinguish it from a slope; the z axis and a tilt "
        "of 6° to distinguish it from a bias",
        accelerometer_causes.find_tilted_accelerometer,
        explains=("wheel_radius", "coulomb", "offset", "slip"),
    ),
    Cause(
        "imu_loose",
        "the IMU rocks on its mount: its scale factor is wrong, and it rings after starts",
        f"{_STILL}, and three starts from there whose force rises fast",
        accelerometer_causes.find_loose_imu,
        explains=(*_OF_FIT, "imu_misaligned", "spikes"),
    ),
    Cause(
        "imu_on_boom",
        "the IMU is mounted on the boom, so that gravity along its forward axis follows the boom",
        "the boom's angle, and standstills at several angles",
        accelerometer_causes.find_imu_on_boom,
        withholds=True,
        withholds_only_if_check_fails=True,
        explains=(*_OF_FIT, "imu_misaligned", "imu_bias", "imu_loose", "slope", "offset"),
    ),
    Cause(
        "imu_bias",
        "the accelerometer has a zero offset",
        f"{_STILL}, the pitch and the z axis; below 6° it cannot be distinguished from a tilt",
        accelerometer_causes.find_accelerometer_bias,
        explains=("wheel_radius", "coulomb", "offset", "slip"),
    ),
    Cause(
        "slope",
        "the ground slopes, but the acceleration does not include gravity",
        f"{_STILL}, and the accelerometer's z axis; or descents without drive",
        accelerometer_causes.find_slope_missing_from_acceleration,
        explains=("imu_misaligned", "offset", *_OF_FIT),
    ),
    Cause(
        "offset",
        "the measured force has a zero offset",
        _STILL,
        fit_causes.find_force_sensor_offset,
        explains=("coulomb",),
    ),
    Cause(
        "delay",
        "a channel's stamps are late or early relative to the other channels",
        f"{_START} whose force changes; {_BOTH} to determine which channel",
        delay_causes.find_channel_delays,
        explains=(
            *("imu_low_passed", "load_changed_inside", "external_force", *_OF_RESIDUALS),
            *("wheel_radius", "slip"),
        ),
        max_explained_strength_ratio=3.0,
    ),
    Cause(
        "imu_low_passed",
        "the accelerometer measures only a part of the acceleration",
        _BOTH,
        accelerometer_causes.find_low_passed_accelerometer,
        withholds=True,
        withholds_only_if_check_fails=True,
        explains=(
            *("wheel_radius", "slip", "delay", "too_little_excitation", "load_changed_inside"),
            *("wrong_scale", "gain_by_speed"),
        ),
    ),
    Cause(
        "wheel_radius",
        "the wheel radius or the accelerometer's scale factor is wrong",
        _BOTH,
        fit_causes.find_wrong_wheel_radius,
    ),
    Cause(
        "slip",
        "the wheels slip: they turn faster than the machine moves",
        _BOTH,
        fit_causes.find_wheel_slip,
    ),
    Cause(
        "coulomb",
        "friction that does not depend on the speed",
        f"starts in both directions, or {_STILL}",
        fit_causes.find_coulomb_friction,
    ),
    Cause(
        "driveline",
        "the measured force is not proportional to the force that accelerates the machine",
        "starts at different throttles",
        fit_causes.find_driveline_nonlinearity,
        explains=("heteroscedastic", "gain_by_speed"),
    ),
    Cause(
        "hysteresis",
        "the force has hysteresis: it reads less while it rises and more while it falls",
        "starts in which the force rises and falls again",
        residual_causes.find_force_hysteresis,
        explains=("delay", "coulomb", "braking_inside", *_OF_RESIDUALS),
    ),
    Cause(
        "gain_drift",
        "the force's gain drifts over the log, or the load changes steadily",
        "starts at the beginning of the log and at its end",
        fit_causes.find_force_gain_drift,
    ),
    Cause(
        "scale_step",
        "the scale of force or speed, or the machine, changes within the log",
        "before the change and after it, an empty machine that returns after a load",
        mass_drifts.find_step_of_lightest_load,
        withholds=True,
        explains=("gain_drift", "coulomb", "gain_by_speed", "wrong_scale"),
    ),
    Cause(
        "warming_friction",
        "friction or rolling resistance changes after the start, as when a machine warms",
        "starts at the beginning of the log and at its end",
        residual_causes.find_warming_friction,
        explains=("coulomb", "gain_drift", "load_changed_inside", "gain_by_speed"),
    ),
    Cause(
        "gain_by_direction",
        "the force is read with another gain in reverse, or the loads depend on the direction",
        "drives in both directions",
        changing_loads.find_force_gain_by_direction,
        withholds=True,
        explains=("driveline", "gain_drift"),
        # load transfer looks like a weak gain by direction
        max_explained_strength_ratio=3.0,
    ),
    Cause(
        "gain_by_speed",
        "the gain of the force, or the scale of the speed, changes with the speed or the force",
        "starts at different throttles",
        residual_causes.find_missing_model_term,
        explains=("coulomb", "load_changed_inside", "heteroscedastic"),
        # a step of the gain looks like a change of load, and is the simpler explanation
        max_explained_strength_ratio=3.0,
    ),
    Cause(
        "braking_inside",
        "braking that the force sensor does not measure is fitted as driving",
        "settings.gate.exclude_braking = false",
        fit_causes.find_braking_fitted_as_driving,
        explains=("driveline", "coulomb", "load_changed_inside", "gain_by_speed"),
    ),
    Cause(
        "braking_left_out",
        "braking is excluded, although the force sensor measures it",
        "driving and braking that each determine a mass",
        setting_causes.find_unmodelled_braking,
        explains=_OF_FEW_STARTS,
    ),
    Cause(
        "external_force",
        "something pushes against the machine, such as a pile",
        "a start of three seconds against it",
        fit_causes.find_external_force,
        # its starts are excluded, and few may remain
        explains=("driveline", "coulomb", "load_changed_inside", *_OF_FEW_STARTS),
    ),
    Cause(
        "load_changed_inside",
        "the load changes while the machine drives",
        "four manoeuvres of three seconds",
        changing_loads.find_load_changing_in_motion,
        explains=("driveline", *_OF_FEW_STARTS),
    ),
    Cause(
        "resonance",
        "the driveline or the frame oscillates, or a load swings",
        f"{_STILL}, and {_START}",
        residual_causes.find_resonance_of_residual,
        # noise of the acceleration attenuates the mass, but not the gain of the wheels
        explains=(*("too_little_excitation", "slip", "coulomb"), *_OF_RESIDUALS),
    ),
    Cause(
        "heteroscedastic",
        "the noise is larger while the machine drives",
        f"{_STILL}, and {_START}",
        residual_causes.find_residual_noise_growth_in_motion,
        explains=(
            *("external_force", "load_changed_inside", "spikes", "too_little_excitation"),
            *("driveline", "coulomb"),
        ),
    ),
    Cause(
        "coloured_residuals",
        "the noise is slow, so that successive samples are not independent",
        _STILL,
        residual_causes.find_slow_noise_at_standstill,
        # noise at standstill may look like a term of the motion if there are few starts
        explains=("heteroscedastic", "driveline", "gain_by_speed", *_OF_EQUATION),
    ),
    Cause(
        "too_little_excitation",
        "the motion contains too little information to weigh the machine",
        "nothing more",
        fit_causes.find_lack_of_excitation,
        withholds=True,
        withholds_only_if_check_fails=True,
        # with little motion, noise of the wheels looks like motion that the accelerometer lacks
        explains=(
            *("wheel_radius", "slip", "coulomb", "delay", "collinear", "driveline"),
            "imu_low_passed",
        ),
    ),
    Cause(
        "wind_up",
        "a recursive method forgets the mass while the motion contains no information",
        "a method that forgets, and windows at steady speed that the gate accepts",
        setting_causes.find_covariance_wind_up,
    ),
    Cause(
        "collinear",
        "the motion does not separate the mass from other terms",
        _START,
        fit_causes.find_terms_inseparable_from_mass,
    ),
)

#: Cause of failed checks that no other cause accounts for; searched last.
UNKNOWN: Final = Cause(
    "unknown",
    "checks fail, and no known cause explains why",
    "a failed check that withholds the mass or widens its uncertainty",
    unexplained.find_failed_checks_without_cause,
    withholds=True,
    withholds_only_if_check_fails=True,
)
