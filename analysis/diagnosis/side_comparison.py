"""Comparison of left and right on straight drives: torques, and wheel speeds with the gyroscope.

The mass comes from the sum of two torques, which looks plausible even if one sensor reads a fifth
of its torque. On a straight drive the two sides differ in torque and speed by only a few percent,
due to tyres, a cross slope and gentle curves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl

from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.diagnosis.measured_channels import RawSignals
from analysis.model.machine import Machine
from analysis.stages.signals.grid_rate import count_rows_in_duration
from estimators.arrays import Bools, Floats

TORQUES: Final = ("torque_left_N_m", "torque_right_N_m")
SPEEDS: Final = ("speed_left_m_s", "speed_right_m_s")
#: Derivation of the yaw rate from the speeds of both sides.
YAW_RATE_BY_SPEEDS: Final = f"({SPEEDS[1]} - {SPEEDS[0]}) / track_width_m"
_YAW_RATE: Final = "yaw_rate_rad_s"


@dataclass(frozen=True)
class SideDifference:
    """Right minus left, relative to their mean.

    Attributes:
        kind: torque, speed, or slip: the speed difference in hard starts minus that in soft ones.
        value_1: the relative difference; 2 if the left side reads 0.
        std_1: standard deviation of the difference.
        resistance_1: part of the difference that a resistance on one side may cause.
    """

    kind: str
    value_1: float
    std_1: float
    resistance_1: float = 0.0

    @property
    def difference_lower_bound_1(self) -> float:
        """Lower bound of the difference; 0 if it may be noise."""
        return max(abs(self.value_1) - self.resistance_1, 0.0) if self.is_significant else 0.0

    @property
    def is_significant(self) -> bool:
        """Whether the difference exceeds its noise."""
        return abs(self.value_1) > LIMITS.sides_min_std * self.std_1

    @property
    def smaller_side(self) -> str:
        """Name of the side that reads less."""
        return "left" if self.value_1 > 0.0 else "right"

    @property
    def side_ratio_1(self) -> float:
        """Ratio of the smaller side to the larger; negative if they oppose each other."""
        half = abs(self.value_1) / 2.0  # 1, except for rounding, if a side reads nothing
        return (1.0 - half) / (1.0 + half)


def compare_left_and_right_sides(
    excitation: pl.DataFrame, signals: RawSignals | None, machine: Machine, t0_unix_ns: int
) -> Mapping[str, SideDifference]:
    """Compare the sides of a log that measures both.

    Args:
        excitation: the grid with its phases.
        signals: raw channels.
        machine: machine file with the track width.
        t0_unix_ns: Unix time of the first row.

    Returns:
        Differences by kind (`torque`, `speed`, `slip`), as far as the log has enough samples.
    """
    if signals is None:
        return {}
    size = count_rows_in_duration(LIMITS.sides_mean_s, machine.settings.align.rate_hz)
    count = excitation.height // size
    channels = signals.channels
    t_ns = excitation["t_ns"].to_numpy()[: count * size] + t0_unix_ns

    def average_blocks(name: str) -> Floats | None:
        if name not in channels or not count:
            return None
        stamps, x = channels[name]
        origin = t_ns[0]
        on_grid = np.interp((t_ns - origin).astype(float), (stamps - origin).astype(float), x)
        return on_grid.reshape(count, size).mean(axis=1)

    def blocks_in_phase(*names: str) -> Bools:
        inside = excitation["phase"].is_in(names).fill_null(value=False).to_numpy()
        blocks = inside[: count * size].reshape(count, size)
        return np.asarray(blocks.all(axis=1), np.bool_)

    turns = average_blocks(_YAW_RATE)
    torques = [average_blocks(name) for name in TORQUES]
    speeds = [average_blocks(name) for name in SPEEDS]
    straight = (
        np.ones(count, np.bool_) if turns is None else np.abs(turns) < LIMITS.straight_max_rad_s
    )
    driving = blocks_in_phase("accelerating", "cruising") & straight
    found: dict[str, SideDifference | None] = {}
    if torques[0] is not None and torques[1] is not None:
        turning = (
            [] if turns is None else [turns, np.clip(turns / LIMITS.scrubbing_rad_s, -1.0, 1.0)]
        )
        stands = blocks_in_phase("standstill")
        ahead = compute_sign_of_driving_direction(speeds, torques)
        found["torque"] = compare_side_torques(
            torques[0], torques[1], turning, ahead, driving, stands
        )
    width_m = machine.machine.track_width_m
    if speeds[0] is not None and speeds[1] is not None and turns is not None and width_m:
        apart = speeds[1] - speeds[0] - width_m * turns
        mean = (speeds[0] + speeds[1]) / 2.0
        push = None
        if torques[0] is not None and torques[1] is not None:
            push = np.maximum(np.abs(torques[0]), np.abs(torques[1]))
        found |= estimate_wheel_speed_difference_of_sides(apart, mean, push, driving)
    return {kind: each for kind, each in found.items() if each is not None}


def compute_sign_of_driving_direction(
    side_speeds: Sequence[Floats | None], side_torques: Sequence[Floats | None]
) -> Floats:
    """Driving direction (n,) by the wheel speeds, or else by the torques."""
    known = next(each for each in (*side_speeds, *side_torques) if each is not None)
    return np.sign(known)


def compare_side_torques(
    left: Floats,
    right: Floats,
    turning_rates: list[Floats],
    driving_direction: Floats,
    is_driving: Bools,
    is_standing: Bools,
) -> SideDifference | None:
    """Slope of the torque difference on the mean torque.

    An offset of one side, or a resistance on one side as on a cross slope, is excluded.
    """
    apart, mean = right - left, (right + left) / 2.0
    if is_driving.sum() < LIMITS.sides_min_means:
        return None
    both_ways = np.ptp(driving_direction[is_driving]) > 0.0
    found = regress_side_difference(
        "torque",
        apart,
        mean,
        [*turning_rates, *([driving_direction] if both_ways else [])],
        is_driving,
    )
    if (
        found is None or found.std_1 > LIMITS.sides_ratio_std_1
    ):  # at one throttle setting, a resistance cannot be distinguished from a wrong share
        rough = regress_side_difference(
            "torque", apart, mean, turning_rates, is_driving | is_standing
        )
        found = (
            found if rough is None else replace(rough, resistance_1=LIMITS.one_sided_resistance_1)
        )
    return found


def estimate_wheel_speed_difference_of_sides(
    difference: Floats, mean_of_sides: Floats, drive_force: Floats | None, is_driving: Bools
) -> dict[str, SideDifference | None]:
    """Relative difference of the wheel speeds, and its increase in hard starts."""
    everywhere = regress_side_difference("speed", difference, mean_of_sides, [], is_driving)
    if drive_force is None or is_driving.sum() < LIMITS.sides_min_means:
        return {"speed": everywhere}
    largest = float(np.quantile(drive_force[is_driving], 0.95))
    soft = is_driving & (drive_force < LIMITS.soft_torque_fraction * largest)
    hard = is_driving & (drive_force > LIMITS.hard_torque_fraction * largest)
    in_soft, in_hard = (
        regress_side_difference("speed", difference, mean_of_sides, [], rows)
        for rows in (soft, hard)
    )
    if in_soft is None or in_hard is None:
        return {"speed": everywhere}
    more = in_hard.value_1 - in_soft.value_1
    std = float(np.hypot(in_soft.std_1, in_hard.std_1))
    return {"speed": in_soft, "slip": SideDifference("slip", more, std)}


def regress_side_difference(
    quantity: str,
    difference: Floats,
    mean_of_sides: Floats,
    other_columns: list[Floats],
    chosen_rows: Bools,
) -> SideDifference | None:
    """Regress the difference on the mean, with a constant and the other columns."""
    if chosen_rows.sum() < LIMITS.sides_min_means:
        return None
    beside = [each[chosen_rows] for each in other_columns if each[chosen_rows].any()]
    A = np.column_stack([mean_of_sides[chosen_rows], np.ones(int(chosen_rows.sum())), *beside])
    size = np.sqrt((A**2).sum(axis=0))
    if not size[0] > 0.0:
        return None
    inverse = np.linalg.pinv((A / size).T @ (A / size), rcond=1e-9, hermitian=True)
    theta = inverse @ ((A / size).T @ difference[chosen_rows]) / size
    left = difference[chosen_rows] - A @ theta
    variance = float(left @ left) / max(left.size - A.shape[1], 1) * LIMITS.sides_correlated_means
    std = float(np.sqrt(variance * inverse[0, 0])) / size[0]
    if not np.isfinite([theta[0], std]).all():
        return None
    return SideDifference(quantity, float(theta[0]), std)
