"""The IMU's axes and place turned into the machine's."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from analysis.machine import ImuMounting
from estimators.errors import DataError

Floats = NDArray[np.float64]

_SPECIFIC_FORCE = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
_RATES = ("roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")


def rotation(imu: ImuMounting) -> Floats:
    """(3, 3) from IMU axes to machine axes: R = Rz(yaw) Ry(pitch) Rx(roll), right-handed."""
    r, p, y = np.deg2rad([imu.roll_deg, imu.pitch_deg, imu.yaw_deg])
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    return Rz @ Ry @ Rx


def inclination(quaternion: Floats, imu: ImuMounting) -> dict[str, Floats]:
    """`pitch` and `roll` of the machine, each (n,) in rad, from its IMU's orientation (4, n).

    The quaternion (x, y, z, w) turns IMU axes into the world's: x forward, y left, z up (REP-103).
    Pitch is positive nose-up here. NaN where the quaternion is zero: an IMU that has none.
    """
    with np.errstate(invalid="ignore"):
        x, y, z, w = quaternion / np.linalg.norm(quaternion, axis=0)
    # the world's vertical in IMU axes, then in those of the machine
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)], -1)
    up_x, up_y, up_z = (up @ rotation(imu).T).T
    return {"pitch": np.arcsin(np.clip(up_x, -1.0, 1.0)), "roll": np.arctan2(up_y, up_z)}


def to_machine_axes(columns: Mapping[str, Floats], imu: ImuMounting) -> dict[str, Floats]:
    """Rotate the accelerometer and the gyroscope, and move the accelerometer to the origin.

    The lever arm's share in the plane is taken off: a_x + ω_z² x + ω̇_z y and a_y + ω_z² y - ω̇_z x,
    as far as the yaw rate and acceleration are known.

    Raises:
        DataError: a rotated sensor of which only some axes are given.
    """
    out = dict(columns)
    R = rotation(imu)
    if not np.allclose(R, np.eye(3), rtol=0.0, atol=1e-12):
        for triple in (_SPECIFIC_FORCE, _RATES):
            given = [name for name in triple if name in out]
            if not given:
                continue
            if len(given) < len(triple):
                missing = ", ".join(f"channels.{n}" for n in triple if n not in out)
                raise DataError(
                    f"machine.imu is rotated, so all three axes are needed: add {missing}"
                )
            turned = R @ np.stack([out[name] for name in triple])
            out.update(zip(triple, turned, strict=True))
    x, y, _ = imu.position_m
    if (x or y) and _SPECIFIC_FORCE[0] in out and _RATES[2] in out:
        square = out[_RATES[2]] ** 2
        turn = out.get("yaw_acc_rad_s2", np.zeros_like(square))
        out[_SPECIFIC_FORCE[0]] = out[_SPECIFIC_FORCE[0]] + square * x + turn * y
        if _SPECIFIC_FORCE[1] in out:
            out[_SPECIFIC_FORCE[1]] = out[_SPECIFIC_FORCE[1]] + square * y - turn * x
    return out
