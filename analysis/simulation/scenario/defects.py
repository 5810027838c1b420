"""Defects of instruments and of their mounting, beyond noise, bias, gain and delay."""

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class SimulatedDefects(BaseModel):
    """What is wrong with the instruments; by default nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    force_lag_s: float = Field(
        default=0.0, ge=0, le=10, description="first-order low-pass of the torque sensors"
    )
    imu_lag_s: float = Field(default=0.0, ge=0, le=10, description="likewise of the IMU")
    speed_lag_s: float = Field(
        default=0.0, ge=0, le=10, description="likewise of the wheel speed sensors"
    )
    acc_tilt_deg: float = Field(
        default=0.0,
        ge=-45,
        le=45,
        description="how far the accelerometer is mounted nose up; the pitch does not know",
    )
    acc_without_gravity: bool = Field(
        default=False, description="the accelerometer's gravity has been taken off"
    )
    vibration_m_s2: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="r.m.s. vibration of the accelerometer along x while the wheels turn",
    )
    vibration_hz: float = Field(default=13.0, gt=0, le=5000, description="its frequency")
    vibration_bandwidth_hz: float = Field(
        default=5.0, gt=0, le=1000, description="its bandwidth: half power to half power"
    )
    force_share_s2_m: float = Field(
        default=0.0,
        ge=-0.2,
        le=0.2,
        description="load transfer: part of the measured share that is lost a m/s² of forward "
        "acceleration",
    )
    force_share_1_kg: float = Field(
        default=0.0, ge=-1e-2, le=1e-2, description="part that it gains a kg of load"
    )
    force_gain_drift: float = Field(
        default=0.0,
        ge=-1,
        le=1,
        description="part by which the force gain grows over a log, linearly",
    )
    force_clip_N: float = Field(
        default=0.0,
        ge=0,
        le=1e7,
        description="total force beyond which the torque sensors read no more, half on each side; "
        "0: none",
    )
    left_torque_gain: float = Field(
        default=1.0, ge=-10, le=10, description="of the left torque sensor alone; -1: a wrong sign"
    )
    sides_swapped: bool = Field(
        default=False, description="left and right are taken for each other"
    )
    frozen_topic: Literal["none", "imu", "torque", "speed"] = Field(
        default="none", description="topic whose values repeat while its stamps go on"
    )
    frozen_s: float = Field(default=1.0, gt=0, le=3600, description="how long they repeat")
    frozen_every_s: float = Field(
        default=30.0, gt=0, le=1e6, description="how often, first after so long"
    )

    @property
    def acc_tilt_rad(self) -> float:
        """How far the accelerometer is mounted nose up."""
        return math.radians(self.acc_tilt_deg)
