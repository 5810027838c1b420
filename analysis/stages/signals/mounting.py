"""Transform the IMU's readings to the machine's axes and origin."""

from collections.abc import Iterable, Mapping

import numpy as np

from analysis.model.machine_body import ImuMounting
from analysis.model.settings import AlignSettings
from analysis.stages.signals import filters
from estimators.arrays import Floats, Ints
from estimators.errors import DataError

Series = tuple[Ints, Floats]

_SPECIFIC_FORCE = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
_RATES = ("roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")


def compute_rotation_to_machine_axes(imu: ImuMounting) -> Floats:
    """Rotation (3, 3) from IMU to machine axes, R = Rz(yaw) Ry(pitch) Rx(roll), right-handed."""
    r, p, y = np.deg2rad([imu.roll_deg, imu.pitch_deg, imu.yaw_deg])
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    return Rz @ Ry @ Rx


def is_imu_rotated(imu: ImuMounting) -> bool:
    """Whether the IMU's axes differ from the machine's by at least 1e-12 rad."""
    if not (imu.roll_deg or imu.pitch_deg or imu.yaw_deg):
        return False
    return not np.allclose(compute_rotation_to_machine_axes(imu), np.eye(3), rtol=0.0, atol=1e-12)


def compute_pitch_and_roll(quaternion: Floats, imu: ImuMounting) -> dict[str, Floats]:
    """`pitch` and `roll` of the machine, (n,) in rad, from its IMU's orientation (4, n).

    The quaternion (x, y, z, w) rotates IMU axes to world axes: x forward, y left, z up (REP-103).
    Pitch is positive nose-up. A zero quaternion, of an IMU without orientation, gives NaN.
    """
    with np.errstate(invalid="ignore"):
        x, y, z, w = quaternion / np.linalg.norm(quaternion, axis=0)
    # the world's vertical in IMU axes, then in those of the machine
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)], -1)
    up_x, up_y, up_z = (up @ compute_rotation_to_machine_axes(imu).T).T
    return {"pitch": np.arcsin(np.clip(up_x, -1.0, 1.0)), "roll": np.arctan2(up_y, up_z)}


def rotate_imu_to_machine_axes(
    series: Mapping[str, Series], imu: ImuMounting, settings: AlignSettings
) -> dict[str, Series]:
    """Rotate the accelerometer and the gyroscope, each at its own rate, before any derivative.

    Args:
        series: stamps (n,) and samples (n,) by channel, in IMU axes.
        imu: mounting of the IMU.
        settings: gap rule for interpolating an axis with other stamps than the first.

    Raises:
        DataError: some axes of a rotated sensor are missing.
    """
    out = dict(series)
    if not is_imu_rotated(imu):
        return out
    R = compute_rotation_to_machine_axes(imu)
    for triple in (_SPECIFIC_FORCE, _RATES):
        given = [name for name in triple if name in series]
        if not given:
            continue
        if len(given) < len(triple):
            missing = ", ".join(f"channels.{n}" for n in triple if n not in series)
            raise DataError(f"machine.imu is rotated, which needs all three axes; add {missing}")
        t = series[triple[0]][0]
        for name in triple:
            t = _interpolate_series_at_stamps(series[name], t, settings)[0]
        seen = np.stack(
            [_interpolate_series_at_stamps(series[name], t, settings)[1] for name in triple]
        )
        out.update((name, (t, turned)) for name, turned in zip(triple, R @ seen, strict=True))
    return out


def list_axes_rotated_together(
    name: str, channel_names: Iterable[str], imu: ImuMounting
) -> tuple[str, ...]:
    """Channels of the axes that are rotated together with this one, itself included.

    Empty if the IMU is not rotated.
    """
    for triple in (_SPECIFIC_FORCE, _RATES):
        if name in triple and is_imu_rotated(imu):
            return tuple(each for each in triple if each in set(channel_names))
    return ()


def _interpolate_series_at_stamps(
    series: Series, stamps_ns: Ints, settings: AlignSettings
) -> Series:
    return filters.interpolate_linearly(
        *series, stamps_ns, filters.compute_gap_threshold_ns(series[0], settings)
    )


def transfer_acceleration_to_origin(
    columns: Mapping[str, Floats], imu: ImuMounting
) -> dict[str, Floats]:
    """Transfer the accelerometer's readings from its position to the origin, in machine axes.

    The planar effect of the lever arm is removed: a_x + ω_z² x + ω̇_z y and a_y + ω_z² y - ω̇_z x,
    as far as yaw rate and yaw acceleration are known.
    """
    out = dict(columns)
    x, y, _ = imu.position_m
    if (x or y) and _SPECIFIC_FORCE[0] in out and _RATES[2] in out:
        square = out[_RATES[2]] ** 2
        turn = out.get("yaw_acc_rad_s2", np.zeros_like(square))
        out[_SPECIFIC_FORCE[0]] = out[_SPECIFIC_FORCE[0]] + square * x + turn * y
        if _SPECIFIC_FORCE[1] in out:
            out[_SPECIFIC_FORCE[1]] = out[_SPECIFIC_FORCE[1]] + square * y - turn * x
    return out
