"""Guess of the IMU's orientation: roll and pitch from gravity, yaw from driving.

Gravity cannot distinguish a tilted sensor from sloping ground, so angles are rounded to steps that
a slope hardly changes, and a tilt that a slope could explain is uncertain.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.machine_body import ImuMounting
from analysis.model.schema import get_column_values
from analysis.stages.signals.filters import find_slices_between_gaps
from analysis.stages.signals.mounting import compute_rotation_to_machine_axes
from analysis.stages.signals.resample import average_about_instants
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints

_AXES: Final = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")


@dataclass(frozen=True, slots=True)
class MountingGuess:
    """Estimated angles for `[machine.imu]`.

    Attributes:
        roll_deg: rounded roll.
        pitch_deg: rounded pitch.
        yaw_deg: rounded yaw; None if the log does not determine it.
        tilt_deg: angle between gravity and the sensor's z axis, not rounded.
        yaw_std_deg: standard deviation of the unrounded yaw; NaN without one.
        stood: whether gravity was measured at standstill; otherwise it is the mean over the log.
    """

    roll_deg: float
    pitch_deg: float
    yaw_deg: float | None
    tilt_deg: float
    yaw_std_deg: float
    stood: bool

    @property
    def is_tilt_beyond_ground_slope(self) -> bool:
        """Whether the tilt is larger than sloping ground could explain."""
        return self.tilt_deg > LIMITS.max_ground_slope_deg

    @property
    def has_no_rotation(self) -> bool:
        """Whether all rounded angles are 0, so that the sensor's axes may be the machine's."""
        return not (self.roll_deg or self.pitch_deg or self.yaw_deg)


def estimate_imu_mounting(
    t_ns: Ints, specific_force: Floats, speed: tuple[Ints, Floats] | None
) -> MountingGuess | None:
    """Estimate the IMU's orientation from its specific force and the wheel speed.

    Args:
        t_ns: (n,) stamps, strictly ascending.
        specific_force: (n, 3) in m/s², along the sensor's axes.
        speed: stamps and speeds (m,), positive forward, in any unit; None if there are none.

    Returns:
        None if the mean specific force is not gravity.
    """
    still = (
        mark_standstill_samples(t_ns, speed) if speed is not None else np.zeros(t_ns.size, np.bool_)
    )
    stood = bool(still.any())
    gravity = np.median(specific_force[still], axis=0) if stood else specific_force.mean(axis=0)
    size = float(np.linalg.norm(gravity))
    if not LIMITS.gravity_range_m_s2[0] < size < LIMITS.gravity_range_m_s2[1]:
        return None
    x, y, z = gravity / size
    tilt_deg = float(np.degrees(np.arccos(np.clip(z, -1.0, 1.0))))
    # with the x axis vertical, roll and yaw are the same rotation
    upright = np.hypot(y, z) < np.sin(np.deg2rad(LIMITS.tilt_step_deg / 2))
    roll_deg = 0.0 if upright else float(np.degrees(np.arctan2(y, z)))
    pitch_deg = float(np.degrees(np.arctan2(-x, z if upright else np.hypot(y, z))))
    roll_deg, pitch_deg = (
        round_angle_deg(angle, LIMITS.tilt_step_deg) for angle in (roll_deg, pitch_deg)
    )
    levelled = (
        specific_force
        @ compute_rotation_to_machine_axes(ImuMounting(roll_deg=roll_deg, pitch_deg=pitch_deg)).T
    )
    yaw_deg, std_deg = (
        estimate_imu_yaw_and_std_deg(t_ns, levelled, speed)
        if speed is not None
        else (np.nan, np.nan)
    )
    step_deg = next((step for step in LIMITS.yaw_steps_deg if 2 * std_deg <= step), None)
    return MountingGuess(
        roll_deg=roll_deg,
        pitch_deg=pitch_deg,
        yaw_deg=None if step_deg is None else round_angle_deg(yaw_deg, step_deg),
        tilt_deg=tilt_deg,
        yaw_std_deg=std_deg,
        stood=stood,
    )


def estimate_gravity_tilt_deg(frame: pl.DataFrame, machine: Machine) -> float:
    """Angle in degrees between gravity at standstill and the machine's +z axis.

    A lower bound of that angle if the accelerometer has an x axis only.

    Args:
        frame: `aligned` or `excitation`, in machine axes.
        machine: machine file with gravity and the standstill speed.

    Returns:
        NaN without an accelerometer or a standstill.
    """
    axes = [get_column_values(frame, name) for name in _AXES if name in frame.columns]
    if _AXES[0] not in frame.columns or len(axes) == 2:
        return float("nan")
    if "phase" in frame.columns:
        still = (frame["phase"] == "standstill").fill_null(value=False).to_numpy()
    else:
        slow = np.abs(get_column_values(frame, "speed_x_m_s"))
        still = slow < machine.settings.phases.standstill_speed_m_s
        t_ns = frame["t_ns"].to_numpy()
        still = mark_long_standstills(t_ns, still)
    force = np.stack(axes, axis=1)[still]
    force = force[~np.isnan(force).any(axis=1)]
    if not force.size:
        return float("nan")
    mean = np.median(force, axis=0)
    if len(axes) > 1 and not mean.any():  # an accelerometer that feels no gravity shows no tilt
        return float("nan")
    if len(axes) == 1:
        share = float(np.abs(mean[0])) / machine.machine.gravity_m_s2
        return float(np.degrees(np.arcsin(min(share, 1.0))))
    return float(np.degrees(np.arccos(np.clip(mean[2] / np.linalg.norm(mean), -1.0, 1.0))))


def round_angle_deg(angle_deg: float, step_deg: float) -> float:
    """Round an angle to a multiple of a step, in (-180°, 180°], without -0."""
    angle = round(angle_deg / step_deg) * step_deg
    return angle + 360.0 if angle <= -180.0 else angle + 0.0


def mark_standstill_samples(t_ns: Ints, speed: tuple[Ints, Floats]) -> Bools:
    """Mask (n,) of samples at standstill, without those just before and after motion."""
    stamps, v = speed
    slow = np.abs(v) <= LIMITS.standing_speed_fraction * np.quantile(np.abs(v), 0.99)
    still = mark_long_standstills(stamps, slow)
    if not still.any() or still.all():
        return np.full(t_ns.size, bool(still.all()) and v.size > 0)
    before = np.clip(np.searchsorted(stamps, t_ns, side="right") - 1, 0, stamps.size - 1)
    after = np.clip(np.searchsorted(stamps, t_ns), 0, stamps.size - 1)
    return still[before] & still[after]


def mark_long_standstills(t_ns: Ints, is_standing: Bools) -> Bools:
    """Mask (n,) of standstills of at least half a second without gaps."""
    kept = np.zeros(is_standing.size, np.bool_)
    index = np.flatnonzero(is_standing)
    if not index.size:
        return kept
    # a moving sample between two standing ones ends a stretch
    edges = np.flatnonzero(np.diff(index) > 1) + 1
    for run in np.split(index, edges):
        for part in find_slices_between_gaps(t_ns[run], LIMITS.standing_min_ns):
            each = run[part]
            if t_ns[each[-1]] - t_ns[each[0]] >= LIMITS.standing_min_ns:
                kept[each] = True
    return kept


def estimate_imu_yaw_and_std_deg(
    t_ns: Ints, levelled_specific_force: Floats, speed: tuple[Ints, Floats]
) -> tuple[float, float]:
    """Yaw and its standard deviation in degrees; NaN if driving does not determine it.

    The horizontal specific force is regressed on the change of wheel speed over the same spans; the
    direction of the coefficients is the machine's x axis.
    """
    stamps, v = speed
    first = max(int(t_ns[0]), int(stamps[0]))
    count = int(min(int(t_ns[-1]), int(stamps[-1])) - first) // LIMITS.yaw_span_ns
    if count < LIMITS.yaw_min_spans:
        return np.nan, np.nan
    edges = first + np.arange(count + 1) * LIMITS.yaw_span_ns
    wheels = (
        np.diff(np.interp((edges - first) / 1e9, (stamps - first) / 1e9, v))
        * 1e9
        / LIMITS.yaw_span_ns
    )
    longest_ns = float(LIMITS.yaw_span_ns)
    seen = np.stack(
        [
            average_about_instants(
                t_ns,
                levelled_specific_force[:, axis],
                edges[:-1] + LIMITS.yaw_span_ns // 2,
                LIMITS.yaw_span_ns,
                longest_ns,
            )
            for axis in (0, 1)
        ],
        axis=1,
    )
    kept = ~np.isnan(seen).any(axis=1)
    wheels, seen = wheels[kept], seen[kept]
    if wheels.size < LIMITS.yaw_min_spans or not np.ptp(wheels) > 0:
        return np.nan, np.nan
    wheels = wheels - wheels.mean()
    seen = seen - seen.mean(axis=0)
    power = float(wheels @ wheels)
    slope = wheels @ seen / power
    size = float(np.hypot(*slope))
    forward = slope / size
    along = seen @ forward
    if float(along @ wheels) < LIMITS.yaw_min_correlation * float(np.sqrt((along @ along) * power)):
        return np.nan, np.nan
    across = seen @ np.array([-forward[1], forward[0]])
    std = float(np.sqrt(across @ across / (wheels.size - 2) / power)) / size
    return float(np.degrees(-np.arctan2(forward[1], forward[0]))), float(np.degrees(std))
