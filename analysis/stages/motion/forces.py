"""Force, torque and regressor acceleration from the smoothed motion: (17), (18), (4)."""

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.axes import YAW_COLUMNS
from analysis.model.column_arrays import ColumnArrays
from analysis.model.machine import Machine
from analysis.model.machine_body import Body
from analysis.model.schema import FRAMES, build_frame, get_column_values
from analysis.stages.motion.phases import classify_motion_phases, compute_trailing_speed_rate
from estimators.arrays import Floats


def compute_excitation(smoothed: pl.DataFrame, machine: Machine) -> pl.DataFrame:
    """Make the frame `excitation`: the input of the estimators, and the phase of motion.

    Args:
        smoothed: `aligned` after the moving mean.
        machine: machine file with wheel radius, track width, force share and settings.

    Returns:
        `excitation`.
    """
    return build_frame("excitation", compute_excitation_columns(smoothed, machine))


def compute_excitation_columns(
    smoothed: pl.DataFrame | ColumnArrays, machine: Machine
) -> dict[str, NDArray[Any] | pl.Series]:
    """Columns of the frame that `compute_excitation` makes, NaN for null; the phase as a series."""
    settings = machine.settings
    speed = get_column_values(smoothed, "speed_x_m_s")
    rate = compute_trailing_speed_rate(speed, settings)
    declared = {column.name for column in FRAMES["excitation"].columns}
    columns: dict[str, NDArray[Any] | pl.Series] = {
        # arrays: of series, `build` would look for NaN by a query
        name: np.asarray(smoothed[name]) if name == "t_ns" else get_column_values(smoothed, name)
        for name in smoothed.columns
        if name in declared
    }
    columns["force_x_N"] = compute_longitudinal_force(smoothed, machine.machine)
    torque = compute_yaw_torque(smoothed, machine.machine)
    if torque is not None:
        columns["torque_z_N_m"] = torque
    columns["regressor_acc_x_m_s2"] = compute_regressor_acceleration(smoothed, machine)
    if set(YAW_COLUMNS) <= set(columns):
        columns["regressor_acc_y_m_s2"] = compute_lateral_acceleration(smoothed, machine)
    columns["speed_rate_x_m_s2"] = rate
    columns["phase"] = classify_motion_phases(smoothed, speed, rate, settings)
    return columns


def compute_longitudinal_force(smoothed: pl.DataFrame | ColumnArrays, body: Body) -> Floats:
    """Force (rows,) in N by (17): (τ_r + τ_l) / r, divided by the share of the measured wheels."""
    if "force_x_N" in smoothed.columns:
        force = get_column_values(smoothed, "force_x_N") / body.force_share
    else:
        radius = float(body.wheel_radius_m or np.nan)
        sides = ("torque_right_N_m", "torque_left_N_m")
        right, left = (get_column_values(smoothed, side) for side in sides)
        force = (right + left) / radius / body.force_share
    if body.force_gain_in_reverse is None:
        return force
    reverses = get_column_values(smoothed, "speed_x_m_s") < 0.0
    return np.where(reverses, force / body.force_gain_in_reverse, force)


def compute_yaw_torque(smoothed: pl.DataFrame | ColumnArrays, body: Body) -> Floats | None:
    """Yaw torque (rows,) in N·m by (18): (τ_r - τ_l) / r · L/2, divided by the force share.

    None if the channels or the track width are missing.
    """
    if "torque_z_N_m" in smoothed.columns:
        return get_column_values(smoothed, "torque_z_N_m") / body.force_share
    sides = {"torque_right_N_m", "torque_left_N_m"}
    if body.wheel_radius_m is None or body.track_width_m is None:
        return None
    if not sides <= set(smoothed.columns):
        return None
    difference = get_column_values(smoothed, "torque_right_N_m") - get_column_values(
        smoothed, "torque_left_N_m"
    )
    return difference / body.wheel_radius_m * body.track_width_m / 2.0 / body.force_share


def compute_regressor_acceleration(
    smoothed: pl.DataFrame | ColumnArrays, machine: Machine
) -> Floats:
    """Acceleration that multiplies the mass in (7), (rows,) in m/s².

    Gravity is moved to the left side of (4): the accelerometer's specific force includes it, while
    g·sin(pitch) is added to an acceleration from the wheels, with the pitch positive nose-up and 0
    where none is given.
    """
    if machine.settings.forces.acceleration == "specific_force":
        return get_column_values(smoothed, "specific_force_x_m_s2")
    acceleration = get_column_values(smoothed, "acc_x_m_s2")
    if "pitch_rad" in smoothed.columns:
        pitch = get_column_values(smoothed, "pitch_rad")
        acceleration = acceleration + machine.machine.gravity_m_s2 * np.sin(pitch)
    return acceleration


def compute_lateral_acceleration(smoothed: pl.DataFrame | ColumnArrays, machine: Machine) -> Floats:
    """Specific force of the origin to the left, (rows,) in m/s².

    Measured by the accelerometer if that is chosen and has a y axis: it includes the sideways slip
    of a skid-steer. Otherwise ω v + g·sin(roll), which holds for wheels that do not slip sideways.
    """
    measured = "specific_force_y_m_s2" in smoothed.columns
    if machine.settings.forces.acceleration == "specific_force" and measured:
        return get_column_values(smoothed, "specific_force_y_m_s2")
    acceleration = get_column_values(smoothed, "yaw_rate_rad_s") * get_column_values(
        smoothed, "speed_x_m_s"
    )
    if "roll_rad" in smoothed.columns:
        roll = get_column_values(smoothed, "roll_rad")
        acceleration = acceleration + machine.machine.gravity_m_s2 * np.sin(roll)
    return acceleration
