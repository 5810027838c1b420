"""The reduced model of straight motion (7): a_x m + v_x b [+ sign(v) c] = f_x."""

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.schema import values
from analysis.settings import Settings
from estimators import planar
from estimators.trace import Trace

Floats = NDArray[np.float64]

#: Columns of the estimate frames, in the order of the regressor's columns.
PARAMETERS = (
    ("mass_kg", "mass_std_kg"),
    ("friction_x_N_s_m", "friction_x_std_N_s_m"),
    ("coulomb_x_N", "coulomb_x_std_N"),
)


def straight(excitation: pl.DataFrame, settings: Settings) -> tuple[Floats, Floats]:
    """A (rows, 2 or 3) and f (rows,): the x row of (7) alone, NaN where a sample is missing.

    The y and z rows as printed set m·a_y and m·a_z to zero, which ruins the mass with the
    accelerometer's 9.81 m/s² in a_z.
    """
    direction = values(excitation, "direction_x_1") if settings.coulomb else None
    A = planar.straight(
        values(excitation, "regressor_acc_x_m_s2"), values(excitation, "speed_x_m_s"), direction
    )
    return np.ascontiguousarray(A), values(excitation, "force_x_N")


def theta_columns(theta: Floats, std: Floats) -> dict[str, Floats]:
    """Name the parameters (rows, p) and their deviations as the frames do."""
    columns: dict[str, Floats] = {}
    for i, (name, name_std) in enumerate(PARAMETERS[: theta.shape[1]]):
        columns[name] = theta[:, i]
        columns[name_std] = std[:, i]
    return columns


def trace_columns(traced: Trace) -> dict[str, Floats]:
    """What a trace says of each of its rows, as the frames name it."""
    return {
        **theta_columns(traced.theta, traced.std),
        "residual_rms_N": traced.residual_rms,
        "condition_1": traced.condition,
    }


def theta_of(estimates: pl.DataFrame) -> tuple[Floats, Floats]:
    """The parameters (rows, p) and deviations (rows, p) that `theta_columns` named."""
    present = [pair for pair in PARAMETERS if pair[0] in estimates.columns]
    theta = np.column_stack([values(estimates, name) for name, _ in present])
    std = np.column_stack([values(estimates, name) for _, name in present])
    return theta, std
