"""The table of terms of force and yaw torque besides mass, inertia, moments and friction.

As in straight motion (`analysis.weighing.nuisances`), each term has its columns, a prior whose
width scales with the machine, and a description. Some are forces (offset, Coulomb friction). Errors
of the accelerometer (tilt, bias, an unmeasured slope, its position) are proportional to the mass in
the longitudinal force, and to the first moments in the yaw torque.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.model.machine import Machine
from analysis.model.prior_settings import PriorSettings
from analysis.model.uncertainty_sources import IMU_POSITION, SCALES, ScaleFactor, has_side_torques
from analysis.planar.planar_limits import LIMITS
from analysis.planar.planar_motion import (
    PlanarDrive,
    TurningSamples,
    has_forward_accelerometer,
    has_lateral_accelerometer,
)
from analysis.weighing.nuisances import (
    compute_constant_force_prior_std_newtons,
    compute_friction_prior_std_newtons,
)
from estimators.arrays import Floats

#: Column of the force, and of the yaw torque; None means 0.
Columns = tuple[Floats | None, Floats | None]
#: The same columns as a weighted sum of the regressor's six columns: weights by column index.
ColumnCombination = tuple[Mapping[int, float], Mapping[int, float]]
_MASS, _INERTIA, _MOMENT_X, _MOMENT_Y, _, _FRICTION_Z = range(6)
_GAIN: Final = SCALES[0]


@dataclass(frozen=True, slots=True)
class Term:
    """A term of the planar fit.

    Attributes:
        name: name in frames and budgets.
        columns: computes its columns.
        combination: computes its part that is a weighted sum of the six columns and their noise.
        compute_prior_std: computes its prior standard deviation, about the mean 0; 0 if exact.
        meaning: what it models, in a sentence.
        reduced_by: what would reduce its uncertainty.
        axes: x, z, or xz for both rows.
        applies: whether the term applies to a machine.
        stated: setting of the machine file for the term, which names its part of the budget.
        least_u: smallest standard uncertainty of the term in any fit, by other effects that look
            like it.
    """

    name: str
    columns: Callable[[TurningSamples], Columns]
    compute_prior_std: Callable[[PlanarDrive, PriorSettings], float]
    meaning: str
    reduced_by: str
    axes: str
    applies: Callable[[Machine], bool] = lambda _: True
    stated: ScaleFactor | None = None
    least_u: float = 0.0
    combination: Callable[[PlanarDrive], ColumnCombination] = lambda _: ({}, {})

    def list_combined_columns(self, drive: PlanarDrive, rows: slice) -> set[int]:
        """Indices of the six columns that the term is a weighted sum of, in these rows."""
        return {n for row in self.combination(drive)[rows] for n, share in row.items() if share}


def has_unmeasured_slope(machine: Machine) -> bool:
    """Whether no channel shows the slope along the machine."""
    return not has_forward_accelerometer(machine) and "pitch_rad" not in machine.channels


def _has_unmeasured_lateral_slope(machine: Machine) -> bool:
    return not has_lateral_accelerometer(machine) and "roll_rad" not in machine.channels


def _has_unknown_slope(machine: Machine) -> bool:
    return has_unmeasured_slope(machine) or _has_unmeasured_lateral_slope(machine)


def make_unmeasured_gravity_columns(turn: TurningSamples, along: Floats, across: Floats) -> Columns:
    """Force and yaw torque by gravity along and across the machine; 0 where it is measured."""
    x = along if has_unmeasured_slope(turn.drive.machine) else 0.0 * along
    y = across if _has_unmeasured_lateral_slope(turn.drive.machine) else 0.0 * across
    return (turn.drive.mass_kg * x, turn.drive.moment_x_kg_m * y - turn.drive.moment_y_kg_m * x)


def _make_longitudinal_slip_columns(turn: TurningSamples) -> Columns:
    """Columns of longitudinal slip in both equations."""
    slip = np.abs(turn.speed) * np.abs(turn.force)
    drive, sideways = turn.drive, None
    if not has_lateral_accelerometer(drive.machine) and drive.mass_kg:
        sideways = -drive.moment_x_kg_m / drive.mass_kg * turn.yaw_rate * np.sign(turn.speed) * slip
    along = -turn.slip_rate if not has_forward_accelerometer(drive.machine) else None
    return along, sideways


def _make_gyro_bias_columns(turn: TurningSamples) -> Columns:
    sideways = 0.0 if has_lateral_accelerometer(turn.drive.machine) else turn.drive.moment_x_kg_m
    return (
        -2.0 * turn.drive.moment_x_kg_m * turn.yaw_rate,
        sideways * turn.speed + turn.drive.turning_friction,
    )


def _combine_columns_by_gyro_gain_error(drive: PlanarDrive) -> ColumnCombination:
    """Factors of the six columns in the column of an error of the gyroscope's gain."""
    turned = {_INERTIA: drive.inertia_z_kg_m2, _FRICTION_Z: drive.turning_friction}
    turned[_MOMENT_X] = 0.0 if has_lateral_accelerometer(drive.machine) else drive.moment_x_kg_m
    return {_MOMENT_X: 2.0 * drive.moment_x_kg_m, _MOMENT_Y: drive.moment_y_kg_m}, turned


def _combine_columns_by_accelerometer_gain_error(drive: PlanarDrive) -> ColumnCombination:
    sideways = drive.moment_x_kg_m if has_lateral_accelerometer(drive.machine) else 0.0
    return {_MASS: drive.mass_kg}, {_MOMENT_X: sideways, _MOMENT_Y: drive.moment_y_kg_m}


def _combine_columns_by_lateral_force_arm(drive: PlanarDrive) -> ColumnCombination:
    """Factors of the six columns in the column of an unknown arm of the sideways force."""
    # the sideways force: m s_y + mc_x ω̇
    return {}, {_MOMENT_X: drive.mass_kg, _INERTIA: drive.moment_x_kg_m}


def _make_imu_y_error_columns(turn: TurningSamples) -> Columns:
    sees_sideways = has_lateral_accelerometer(turn.drive.machine)
    return None, turn.drive.moment_x_kg_m * sees_sideways * turn.yaw_rate**2


def _combine_columns_by_imu_x_error(drive: PlanarDrive) -> ColumnCombination:
    """Factors of the six columns in the column of an error of the IMU's position ahead."""
    sideways = drive.moment_x_kg_m if has_lateral_accelerometer(drive.machine) else 0.0
    return {_MOMENT_X: -drive.mass_kg}, {_INERTIA: -sideways}


def _combine_columns_by_imu_y_error(drive: PlanarDrive) -> ColumnCombination:
    """Factors of the six columns in the column of an error of the IMU's position to the left."""
    return {_MOMENT_Y: -drive.mass_kg}, {_INERTIA: -drive.moment_y_kg_m}


def _compute_planar_coulomb_prior_std(drive: PlanarDrive, priors: PriorSettings) -> float:
    return compute_friction_prior_std_newtons(drive.peak_force_N, drive.weight_newtons, priors)


def _compute_imu_position_prior_std(drive: PlanarDrive, _priors: PriorSettings) -> float:
    return IMU_POSITION.u(drive.machine) or 0.0


#: All terms, in the order of the fit's parameters; a fit uses those that apply to its machine.
TERMS: Final = (
    Term(
        "const",
        lambda m: (m.one, None),
        lambda d, s: compute_constant_force_prior_std_newtons(d.peak_force_N, d.weight_newtons, s),
        "a constant force: offset of the force, tilt or bias of the accelerometer",
        "starts in both directions, or at different throttles",
        "x",
    ),
    Term(
        "direction",
        lambda m: (m.direction_x, None),
        _compute_planar_coulomb_prior_std,
        "Coulomb friction and rolling resistance",
        "driving both ways, and starts at different throttles",
        "x",
    ),
    Term(
        # if wheels roll in opposite directions, rolling resistance gives no force
        "direction_spinning",
        lambda m: (m.direction_x_spinning, None),
        _compute_planar_coulomb_prior_std,
        "longitudinal Coulomb friction in spins: left and right wheels turn in opposite directions",
        "spins about the origin",
        "x",
    ),
    Term(
        "slip",
        lambda m: (np.abs(m.speed) * m.force, None),
        lambda d, s: s.wheel_slip / d.peak_speed_m_s,
        "longitudinal slip: friction of a wheel speed that is not the ground's",
        "starts at different throttles",
        "x",
    ),
    Term(
        "quadratic",
        lambda m: (m.speed * np.abs(m.speed), None),
        lambda d, s: s.quadratic_share * d.peak_force_N / d.peak_speed_m_s**2,
        "resistance that grows with the square of the speed",
        "cruising at several speeds",
        "x",
    ),
    Term(
        "viscous_drift",
        lambda m: (m.speed * m.progress, None),
        lambda d, s: s.viscous_drift_share * d.peak_force_N / d.peak_speed_m_s,
        "change of viscous friction over the log",
        "a machine that is warm",
        "x",
    ),
    Term(
        "turning_const",
        lambda m: (None, m.one),
        lambda d, s: float(
            np.hypot(
                s.const_share * d.peak_torque_N_m,
                s.const_weight_share * abs(d.moment_x_kg_m) * d.gravity_m_s2,
            )
        ),
        "a constant yaw torque: offset of the torque, roll or sideways bias of the accelerometer",
        "turning both ways",
        "z",
    ),
    Term(
        "turning_direction",
        lambda m: (None, m.direction_z),
        lambda d, s: float(
            np.hypot(s.direction_share * d.peak_torque_N_m, s.scrub_arm_m * d.weight_newtons)
        ),
        "Coulomb friction of turning: tyres that scrub",
        "spins at different throttles, both ways",
        "z",
    ),
    Term(
        # if the sides roll in opposite directions, their rolling resistances form a couple
        "turning_rolling",
        lambda m: (None, m.rolling_z),
        _compute_planar_coulomb_prior_std,
        "rolling resistance of left and right wheels that turn in opposite directions",
        "spins in place as well as turns under way",
        "z",
        has_side_torques,
    ),
    Term(
        "turning_quadratic",
        lambda m: (None, m.yaw_rate * np.abs(m.yaw_rate)),
        lambda d, s: s.quadratic_share * d.peak_torque_N_m / d.peak_yaw_rate_rad_s**2,
        "friction of turning that is not proportional to the yaw rate",
        "spins at different throttles",
        "z",
    ),
    Term(
        "turning_sideways",
        lambda m: (None, m.yaw_rate * m.acc_y**2),
        lambda d, s: (
            s.scrub_share * d.peak_torque_N_m / (d.peak_yaw_rate_rad_s * d.peak_acc_y_m_s2**2)
        ),
        "tyres that already slide sideways, and so resist turning less",
        "spins in place as well as turns under way",
        "z",
    ),
    Term(
        "turning_under_way",
        lambda m: (None, m.yaw_rate * np.abs(m.speed)),
        lambda d, s: s.scrub_share * d.peak_torque_N_m / (d.peak_yaw_rate_rad_s * d.peak_speed_m_s),
        "friction of turning under way, in addition to that of a spin in place",
        "spins in place as well as turns under way",
        "z",
    ),
    Term(
        "lateral_arm",
        lambda _: (None, None),
        lambda _, s: s.lateral_arm_m,
        "distance ahead of the origin at which the ground's sideways force acts",
        "an accelerometer at a known position: then the force alone determines the moments",
        "z",
        combination=_combine_columns_by_lateral_force_arm,
    ),
    Term(
        "spin_centre",
        lambda _: (None, None),
        lambda d, _: LIMITS.spin_centre_moment_std_1 * d.half_track_m**2,
        "first moment times the distance of the point about which the machine turns",
        "an accelerometer with a sideways axis, which shows the point of rotation",
        "z",
        lambda machine: has_side_torques(machine) and not has_lateral_accelerometer(machine),
        combination=lambda drive: ({}, {_INERTIA: drive.mass_kg}),
    ),
    Term(
        "turning_drift",
        lambda m: (None, m.yaw_rate * m.progress),
        lambda d, s: s.viscous_drift_share * d.peak_torque_N_m / d.peak_yaw_rate_rad_s,
        "change of the friction of turning over the log",
        "a machine that is warm",
        "z",
    ),
    Term(
        "lag",
        lambda m: (-m.force_rate, -m.torque_rate),
        lambda _, s: s.lag_s,
        "delay of force and torque relative to the motion",
        "clocks that are synchronised",
        "xz",
    ),
    Term(
        "load_transfer",
        lambda m: (m.acc_x * m.force, m.acc_x * m.torque),
        lambda _, s: s.load_transfer_s2_m,
        "the measured wheels' share of the force changes with the acceleration",
        "force measured on all wheels",
        "xz",
        lambda machine: machine.machine.force_share < 1.0,
    ),
    Term(
        "side_gain",
        # noise of the other row, which is uncorrelated if both sides have equal sensors
        lambda m: (
            m.measured_torque / m.drive.half_track_m,
            m.measured_force * m.drive.half_track_m,
        ),
        lambda d, _: _GAIN.u(d.machine) or 0.0,
        "gains of the two sides' torques that differ from each other",
        _GAIN.remedy,
        "xz",
        has_side_torques,
        _GAIN,
        LIMITS.sides_gain_std_1,
    ),
    Term(
        "slip_acceleration",
        _make_longitudinal_slip_columns,
        lambda d, s: d.mass_kg * s.wheel_slip / d.peak_force_N,
        "longitudinal slip: the wheels gain more speed than the machine",
        "an accelerometer on the body",
        "xz",
        lambda machine: not has_lateral_accelerometer(machine),
    ),
    Term(
        "slope_along",
        lambda m: make_unmeasured_gravity_columns(m, np.cos(m.heading_rad), -np.sin(m.heading_rad)),
        lambda d, s: s.const_weight_share * d.gravity_m_s2,
        "a slope along the machine where the log begins, which no channel measures",
        "level ground; an accelerometer, or channels of pitch and roll",
        "xz",
        _has_unknown_slope,
    ),
    Term(
        "slope_across",
        lambda m: make_unmeasured_gravity_columns(m, np.sin(m.heading_rad), np.cos(m.heading_rad)),
        lambda d, s: s.const_weight_share * d.gravity_m_s2,
        "a slope across the machine where the log begins, which no channel measures",
        "level ground; an accelerometer, or channels of pitch and roll",
        "xz",
        _has_unknown_slope,
    ),
    Term(
        "accelerometer_gain",
        lambda _: (None, None),
        lambda _, s: s.gain,
        "gain of the accelerometer",
        "an accelerometer that is calibrated",
        "xz",
        has_forward_accelerometer,
        combination=_combine_columns_by_accelerometer_gain_error,
    ),
    Term(
        "yaw_rate_bias",
        _make_gyro_bias_columns,
        lambda _, s: s.yaw_rate_bias_rad_s,
        "bias of the gyroscope",
        "a gyroscope that is zeroed at standstill",
        "xz",
    ),
    Term(
        "yaw_rate_gain",
        lambda _: (None, None),
        lambda _, s: s.yaw_rate_gain,
        "gain of the gyroscope",
        "turning a known angle",
        "xz",
        combination=_combine_columns_by_gyro_gain_error,
    ),
    Term(
        f"{IMU_POSITION.name}_x",
        # without ω² mc_y in the yaw torque: so small a part must not determine the position
        lambda _: (None, None),
        _compute_imu_position_prior_std,
        f"{IMU_POSITION.meaning}, ahead",
        IMU_POSITION.remedy,
        "xz",
        IMU_POSITION.applies,
        IMU_POSITION,
        combination=_combine_columns_by_imu_x_error,
    ),
    Term(
        f"{IMU_POSITION.name}_y",
        _make_imu_y_error_columns,
        _compute_imu_position_prior_std,
        f"{IMU_POSITION.meaning}, to the left",
        IMU_POSITION.remedy,
        "xz",
        IMU_POSITION.applies,
        IMU_POSITION,
        combination=_combine_columns_by_imu_y_error,
    ),
)
