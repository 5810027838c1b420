"""The two axes of windowed estimation: straight motion (7) and spins (8).

x:  a_x m + v_x b [+ sign(v) c] = f_x
z:  ω̇_z Izz + ω_z b_ψ = τ_z
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.model.schema import get_column_values
from analysis.model.settings import Settings
from estimators.arrays import Floats
from estimators.estimate import Trace
from estimators.planar import planar_rows

#: Columns that the z axis requires.
YAW_COLUMNS: Final = ("torque_z_N_m", "yaw_rate_rad_s", "yaw_acc_rad_s2")


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis: its letter in the gate's columns, and the columns of its estimates.

    Attributes:
        letter: x or z.
        parameters: columns of value and standard deviation, in the order of the regressor.
        residual_rms: column of the residuals' r.m.s.
    """

    letter: str
    parameters: tuple[tuple[str, str], ...]
    residual_rms: str


X: Final = Axis(
    "x",
    (
        ("mass_kg", "mass_std_kg"),
        ("friction_x_N_s_m", "friction_x_std_N_s_m"),
        ("coulomb_x_N", "coulomb_x_std_N"),
    ),
    "residual_rms_N",
)
Z: Final = Axis(
    "z",
    (
        ("inertia_z_kg_m2", "inertia_z_std_kg_m2"),
        ("friction_z_N_m_s", "friction_z_std_N_m_s"),
    ),
    "residual_rms_N_m",
)


def list_axes_allowed_by_channels(excitation: pl.DataFrame) -> tuple[Axis, ...]:
    """The axes that the channels allow: z needs a yaw torque, rate and acceleration."""
    return list_axes_allowed_by_columns(excitation.columns)


def list_axes_allowed_by_columns(columns: Iterable[str]) -> tuple[Axis, ...]:
    """The axes that the columns of `excitation` allow."""
    return (X, Z) if set(YAW_COLUMNS) <= set(columns) else (X,)


def list_regressor_columns(axis: Axis, settings: Settings) -> tuple[str, ...]:
    """Columns of `excitation` for A and f of an axis, that of f last."""
    if axis is Z:
        return ("yaw_acc_rad_s2", "yaw_rate_rad_s", "torque_z_N_m")
    direction = ("direction_x_1",) if settings.forces.coulomb else ()
    return ("regressor_acc_x_m_s2", "speed_x_m_s", *direction, "force_x_N")


def make_regressor_and_force(
    axis: Axis, excitation: pl.DataFrame, settings: Settings
) -> tuple[Floats, Floats]:
    """A (rows, p) and f (rows,) of an axis; NaN if a sample is missing."""
    return (
        make_straight_regressor_and_force(excitation, settings)
        if axis is X
        else make_spin_regressor_and_torque(excitation)
    )


def make_straight_regressor_and_force(
    excitation: pl.DataFrame, settings: Settings
) -> tuple[Floats, Floats]:
    """A (rows, 2 or 3) and f (rows,) of the x row of (7); NaN if a sample is missing.

    The printed y and z rows set m·a_y and m·a_z to zero; with the accelerometer's 9.81 m/s² in a_z
    they would make the mass wrong.
    """
    direction = get_column_values(excitation, "direction_x_1") if settings.forces.coulomb else None
    A = planar_rows.make_straight_regressor(
        get_column_values(excitation, "regressor_acc_x_m_s2"),
        get_column_values(excitation, "speed_x_m_s"),
        direction,
    )
    return np.ascontiguousarray(A), get_column_values(excitation, "force_x_N")


def make_spin_regressor_and_torque(excitation: pl.DataFrame) -> tuple[Floats, Floats]:
    """A (rows, 2) and τ (rows,) of the yaw row of (8); NaN if a sample is missing."""
    A = planar_rows.make_spin_regressor(
        get_column_values(excitation, "yaw_acc_rad_s2"),
        get_column_values(excitation, "yaw_rate_rad_s"),
    )
    return np.ascontiguousarray(A), get_column_values(excitation, "torque_z_N_m")


def make_parameter_columns(axis: Axis, theta: Floats, std: Floats) -> dict[str, Floats]:
    """Parameters (rows, p) and their standard deviations, by the frames' column names."""
    columns: dict[str, Floats] = {}
    for i, (name, name_std) in enumerate(axis.parameters[: theta.shape[1]]):
        columns[name] = theta[:, i]
        columns[name_std] = std[:, i]
    return columns


def make_trace_columns(axis: Axis, trace: Trace) -> dict[str, Floats]:
    """Values of a trace, by the frames' column names."""
    return {
        **make_parameter_columns(axis, trace.theta, trace.std),
        axis.residual_rms: trace.residual_rms,
        "condition_1": trace.condition,
    }


def read_parameters_and_stds(axis: Axis, estimates: pl.DataFrame) -> tuple[Floats, Floats]:
    """Parameters and standard deviations, (rows, p) each, from `make_parameter_columns`."""
    present = [pair for pair in axis.parameters if pair[0] in estimates.columns]
    theta = np.column_stack([get_column_values(estimates, name) for name, _ in present])
    std = np.column_stack([get_column_values(estimates, name) for _, name in present])
    return theta, std


def select_estimate_rows_of_axis(axis: Axis, estimates: pl.DataFrame) -> pl.DataFrame:
    """Rows of an axis; without a column `axis`, all rows belong to x."""
    if "axis" not in estimates.columns:
        return estimates if axis is X else estimates.clear()
    return estimates.filter(pl.col("axis") == axis.letter)
