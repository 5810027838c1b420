"""Sensors and recorder of a scenario, by default as good as the paper's, and their defects.

When each topic is sampled, and what its clock makes of it, belongs to them.
"""

import math
from typing import Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

_FORBID = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
TopicName: TypeAlias = Literal["imu", "torque", "speed", "boom", "odometry", "gnss"]


class SimulatedSensors(BaseModel):
    """Errors of the sensors; white noise unless said otherwise, as standard deviations."""

    model_config = _FORBID

    rate_hz: float = Field(
        default=100.0, ge=1, le=10_000, description="rate of each topic without a rate of its own"
    )
    force_noise_N: float = Field(
        default=60.0, ge=0, description="noise of the total force: (17) over the force share"
    )
    acc_noise_m_s2: float = Field(
        default=0.01, ge=0, description="noise of each accelerometer axis"
    )
    speed_noise_m_s: float = Field(
        default=0.005, ge=0, description="noise of the mean speed of both sides"
    )
    gyro_noise_rad_s: float = Field(default=0.001, ge=0, description="noise of each gyroscope axis")
    pitch_noise_rad: float = Field(
        default=0.0005, ge=0, description="noise of the pitch in the orientation"
    )
    roll_noise_rad: float = Field(
        default=0.0, ge=0, description="noise of the roll in the orientation"
    )
    force_drift_N: float = Field(
        default=0.0,
        ge=0,
        description="coloured noise of the total force: a first-order Gauss-Markov process (AR(1))",
    )
    force_drift_s: float = Field(
        default=1.0,
        gt=0,
        le=1e5,
        description="correlation time of the coloured force noise: e-folding of autocorrelation",
    )
    acc_bias_m_s2: float = Field(default=0.0, description="bias of the accelerometer along x")
    gyro_bias_rad_s: float = Field(default=0.0, description="bias of each gyroscope axis")
    force_bias_N: float = Field(default=0.0, description="bias of the total force")
    force_gain: float = Field(
        default=1.0, gt=0, le=100, description=("ratio of reported to true torque")
    )
    torque_lsb_N_m: float = Field(
        default=0.0, ge=0, description="resolution of each torque sensor; 0: not quantised"
    )
    acc_lsb_m_s2: float = Field(
        default=0.0, ge=0, description="resolution of each accelerometer axis"
    )
    gyro_lsb_rad_s: float = Field(
        default=0.0, ge=0, description="resolution of each gyroscope axis"
    )
    speed_lsb_m_s: float = Field(
        default=0.0, ge=0, description="resolution of the wheel speed of each side"
    )
    angle_lsb_rad: float = Field(default=0.0, ge=0, description="resolution of pitch and roll")
    imu_x_m: float = Field(
        default=0.0, ge=-10, le=10, description="position of the IMU ahead of the origin"
    )
    imu_y_m: float = Field(
        default=0.0, ge=-10, le=10, description="position of the IMU to the left of the origin"
    )
    force_delay_s: float = Field(
        default=0.0, ge=0, le=10, description="delay of the torque sensors"
    )
    speed_delay_s: float = Field(
        default=0.0, ge=0, le=10, description=("delay of the wheel speed sensors")
    )
    imu_delay_s: float = Field(default=0.0, ge=0, le=10, description="delay of the IMU")
    seed: int = Field(default=1, ge=0, description="the same seed gives the same logs")


class SimulatedRecorder(BaseModel):
    """How the logs are recorded: one log a load, all on one time line."""

    model_config = _FORBID

    start_unix_s: int = Field(
        default=1_700_000_000,
        ge=0,
        le=2_000_000_000,
        description="time at which the first log begins",
    )
    machine_id: str = Field(
        default="",
        max_length=64,
        description="serial number in the metadata of the log, if its format has any (MCAP, "
        "rosbag2)",
    )
    load_change_s: float = Field(
        default=120.0, ge=0, le=86_400, description="time between two logs"
    )
    latency_s: float = Field(
        default=0.002, ge=0, le=1, description="smallest latency from measurement to recording"
    )
    latency_jitter_s: float = Field(
        default=0.001,
        ge=0,
        le=1,
        description=("additional delay of a message, uniformly distributed"),
    )
    dropout_share: float = Field(
        default=0.0, ge=0, lt=1, description="share of each topic's messages that are lost, singly"
    )
    swapped_share: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="share of each topic's messages that are recorded after the next",
    )
    blackout_every_s: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        description="mean time between blackouts, in which nothing is recorded; 0: never",
    )
    blackout_s: float = Field(default=1.0, gt=0, le=3600, description="duration of a blackout")


class SimulatedDefects(BaseModel):
    """Defects of the sensors; none by default."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    force_lag_s: float = Field(
        default=0.0, ge=0, le=10, description="time constant of the low-pass of the torque sensors"
    )
    imu_lag_s: float = Field(
        default=0.0, ge=0, le=10, description="time constant of the low-pass of the IMU"
    )
    speed_lag_s: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="time constant of the low-pass of the wheel speed sensors",
    )
    acc_tilt_deg: float = Field(
        default=0.0,
        ge=-45,
        le=45,
        description="tilt of the accelerometer, nose up, that the pitch does not measure",
    )
    acc_without_gravity: bool = Field(
        default=False, description="gravity has been removed from the accelerometer"
    )
    vibration_m_s2: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="r.m.s. vibration of the accelerometer along x while the wheels turn",
    )
    vibration_hz: float = Field(
        default=13.0, gt=0, le=5000, description="centre frequency of the vibration"
    )
    vibration_bandwidth_hz: float = Field(
        default=5.0, gt=0, le=1000, description="bandwidth of the vibration between half powers"
    )
    force_share_s2_m: float = Field(
        default=0.0,
        ge=-0.2,
        le=0.2,
        description="load transfer: part of the measured share that is lost per m/s² of forward "
        "acceleration",
    )
    force_share_1_kg: float = Field(
        default=0.0, ge=-1e-2, le=1e-2, description="relative change of the gain per kg of load"
    )
    force_gain_drift: float = Field(
        default=0.0, ge=-1, le=1, description="relative growth of the force gain over a log, linear"
    )
    force_clip_N: float = Field(
        default=0.0,
        ge=0,
        le=1e7,
        description="total force at which the torque sensors saturate, half on each side; 0: none",
    )
    force_play_N: float = Field(
        default=0.0,
        ge=0,
        le=1e7,
        description="play of the torque sensors: the total force by which they read less while it "
        "rises and more while it falls",
    )
    left_torque_gain: float = Field(
        default=1.0,
        ge=-10,
        le=10,
        description="gain of the left torque sensor alone; -1: a wrong sign",
    )
    sides_swapped: bool = Field(default=False, description="left and right are swapped")
    frozen_topic: Literal["none", "imu", "torque", "speed"] = Field(
        default="none", description="topic that freezes: its values repeat, its stamps go on"
    )
    frozen_s: float = Field(default=1.0, gt=0, le=3600, description="duration of a freeze")
    frozen_every_s: float = Field(
        default=30.0,
        gt=0,
        le=1e6,
        description="time between two freezes, and before the first",
    )

    @property
    def accelerometer_tilt_rad(self) -> float:
        """Angle in rad by which the accelerometer is mounted nose-up."""
        return math.radians(self.acc_tilt_deg)


class SimulatedSampling(BaseModel):
    """Rate, phase and clock of each topic; stamps count from the beginning of a log."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    imu_rate_hz: float = Field(
        default=0.0, ge=0, le=10_000, description="rate of the IMU; 0: sensors.rate_hz"
    )
    torque_rate_hz: float = Field(
        default=0.0, ge=0, le=10_000, description="rate of the torques; 0: sensors.rate_hz"
    )
    speed_rate_hz: float = Field(
        default=0.0, ge=0, le=10_000, description="rate of the wheel speeds; 0: sensors.rate_hz"
    )
    imu_phase_s: float = Field(
        default=-1.0,
        ge=-1,
        le=1,
        description="first IMU sample after the beginning of the log; negative: drawn within a "
        "period from the seed",
    )
    torque_phase_s: float = Field(default=-1.0, ge=-1, le=1, description="the same for the torques")
    speed_phase_s: float = Field(
        default=-1.0, ge=-1, le=1, description="the same for the wheel speeds"
    )
    imu_clock_ppm: float = Field(
        default=0.0,
        ge=-50_000,
        le=50_000,
        description="excess rate of the clock of IMU header stamps; right at the beginning of "
        "the log",
    )
    torque_clock_ppm: float = Field(
        default=0.0, ge=-50_000, le=50_000, description="the same for the torques"
    )
    speed_clock_ppm: float = Field(
        default=0.0, ge=-50_000, le=50_000, description="the same for the wheel speeds"
    )
    stamp_jitter_s: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="largest error of header stamps to either side, uniform, in every topic",
    )

    def rate_hz(self, topic: TopicName, common_hz: float) -> float:
        """Rate of a topic in Hz; `common_hz` for a topic without its own."""
        rates: dict[str, float] = {
            "imu": self.imu_rate_hz,
            "torque": self.torque_rate_hz,
            "speed": self.speed_rate_hz,
        }
        return rates.get(topic) or common_hz

    def phase_s(self, topic: TopicName) -> float:
        """Phase of a topic in s; negative if it is drawn at random."""
        phases: dict[str, float] = {
            "imu": self.imu_phase_s,
            "torque": self.torque_phase_s,
            "speed": self.speed_phase_s,
        }
        return phases.get(topic, -1.0)

    def clock_rate_error_ppm(self, topic: TopicName) -> float:
        """Rate error of a topic's clock in ppm; positive if it runs fast."""
        clocks: dict[str, float] = {
            "imu": self.imu_clock_ppm,
            "torque": self.torque_clock_ppm,
            "speed": self.speed_clock_ppm,
        }
        return clocks.get(topic, 0.0)
