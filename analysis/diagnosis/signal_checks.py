"""Checks of the raw signals, before any low-pass."""

from collections.abc import Callable
from typing import Final

import numpy as np

from analysis.diagnosis.check_inputs import AxisMotion, CheckInputs
from analysis.diagnosis.check_row import CheckRow
from analysis.stages.estimation import fit_quality
from analysis.stages.signals.mounting_guess import estimate_gravity_tilt_deg
from estimators.arrays import Floats


def _compute_unfiltered_opposing_force_fraction(inputs: CheckInputs, motion: AxisMotion) -> float:
    """`opposing_share` by the unfiltered force, since a low-pass would make it undershoot zero."""
    force = interpolate_unfiltered_force(inputs)
    if force is None:
        return np.nan
    return fit_quality.compute_fraction_of_braked_samples_with_opposing_force(
        motion.A, motion.f, motion.braking, motion.speeding, force
    )


def interpolate_unfiltered_force(inputs: CheckInputs) -> Floats | None:
    """Unfiltered force on the grid, (n,) in N; None if the force is derived."""
    if inputs.signals is None:
        return None
    return inputs.signals.interpolate_force(
        inputs.excitation["t_ns"].to_numpy() + inputs.t0_unix_ns
    )


def _has_raw_signals(inputs: CheckInputs, _motion: AxisMotion) -> bool:
    return inputs.signals is not None


def _estimate_imu_tilt_deg(inputs: CheckInputs, _motion: AxisMotion) -> float:
    return estimate_gravity_tilt_deg(inputs.excitation, inputs.machine)


def _read_clock_drift_over_log_s(inputs: CheckInputs, _motion: AxisMotion) -> float:
    return np.nan if inputs.signals is None else inputs.signals.clock_drift_over_log_s


def _make_reader_of_mass_change_over_uncertainty(
    check_name: str,
) -> Callable[[CheckInputs, AxisMotion], float | None]:
    """Make a function that returns the change of the mass without a check's stretches, in u."""

    def read_mass_change_over_u(inputs: CheckInputs, _: AxisMotion) -> float | None:
        found = inputs.left_out.get(check_name)
        return None if found is None else found.mass_change_over_u

    return read_mass_change_over_u


def _make_writer_of_exclusion_text(
    check_name: str,
) -> Callable[[CheckInputs, AxisMotion], str]:
    """Make a function that describes the effect of excluding a check's stretches."""

    def describe_exclusion_effect(inputs: CheckInputs, _: AxisMotion) -> str:
        found = inputs.left_out.get(check_name)
        return "" if found is None else found.exclusion_effect_text

    return describe_exclusion_effect


def _find_largest_side_difference_1(inputs: CheckInputs, _motion: AxisMotion) -> float:
    """Largest relative difference of left and right; NaN without two sides."""
    return max(
        (each.difference_lower_bound_1 for each in inputs.side_differences.values()), default=np.nan
    )


def read_torque_difference_lower_bound_1(inputs: CheckInputs, _motion: AxisMotion) -> float:
    """Lower bound of the torque difference of the sides; NaN unless both are measured."""
    torque = inputs.side_differences.get("torque")
    return np.nan if torque is None else torque.difference_lower_bound_1


def _name_quantity_of_largest_side_difference(inputs: CheckInputs, _motion: AxisMotion) -> str:
    """Quantity in which the sides differ most: torque, speed or slip."""
    worst = max(
        inputs.side_differences.values(),
        key=lambda each: each.difference_lower_bound_1,
        default=None,
    )
    return "" if worst is None else worst.kind


SIGNAL_CHECKS: Final = (
    CheckRow(
        "raw_opposing_share",
        "mass",
        _compute_unfiltered_opposing_force_fraction,
        "fraction of samples braked by the drive in which the raw force opposes the motion",
        minimum="opposing_share_min",
        optional=True,
        remedy="a force with its sign: motor currents often have none",
    ),
    CheckRow(
        "frozen_s",
        "mass",
        lambda inputs, _: (
            np.nan if inputs.signals is None else inputs.signals.longest_frozen_duration_s
        ),
        "longest time in s for which a channel repeats its value while another changes",
        maximum="frozen_max_s",
        applies=_has_raw_signals,
        subject_text=_make_writer_of_exclusion_text("frozen_s"),
        compute_mass_change_over_u=_make_reader_of_mass_change_over_uncertainty("frozen_s"),
        remedy="leave the stretch out, or mend the sensor",
    ),
    CheckRow(
        "clipped_share",
        "mass",
        lambda inputs, _: (
            np.nan if inputs.signals is None else inputs.signals.largest_clipped_fraction
        ),
        "fraction of a force channel's readings at a limit of the sensor or the engine",
        maximum="clipped_max",
        applies=_has_raw_signals,
        subject_text=_make_writer_of_exclusion_text("clipped_share"),
        compute_mass_change_over_u=_make_reader_of_mass_change_over_uncertainty("clipped_share"),
        remedy="settings.gate.saturation_force_N: the force where the sensor clips; valid_range of "
        "the channel, for error codes",
    ),
    CheckRow(
        "side_difference",
        "mass",
        _find_largest_side_difference_1,
        "difference of left and right on straight drives, over their mean; 0 if it is noise",
        maximum="sides_max",
        optional=True,
        subject_text=_name_quantity_of_largest_side_difference,
        consequence="tell",
        remedy="channels.torque_left_N_m and torque_right_N_m, or the speeds: their scales",
    ),
    CheckRow(
        "one_sided_torque",
        "mass",
        read_torque_difference_lower_bound_1,
        "difference of the torques alone, over their mean; above the limit one is not measured",
        maximum="one_sided_max",
        optional=True,
        remedy="the sensor of the side that reads less",
    ),
    CheckRow(
        "clock_drift_s",
        "mass",
        _read_clock_drift_over_log_s,
        "drift in s between the clocks of two topics over the log, by header stamps and log times",
        maximum="clocks_max_s",
        applies=_has_raw_signals,
        remedy="clocks that are synchronised, or a shorter log",
    ),
    CheckRow(
        "imu_tilt_deg",
        "mass",
        _estimate_imu_tilt_deg,
        "angle in degrees between gravity at standstill and the machine's upward axis",
        maximum="imu_tilt_max_deg",
        applies=lambda inputs, _: inputs.machine.settings.forces.acceleration == "specific_force",
        optional=True,
        remedy="machine.imu: payscope init proposes roll, pitch and yaw; without gravity it is "
        "channels.acc_x_m_s2",
    ),
)
