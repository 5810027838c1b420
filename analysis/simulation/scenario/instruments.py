"""Sensors and recorder of a scenario; by default as good as the paper's."""

from pydantic import BaseModel, ConfigDict, Field

_FORBID = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SimulatedSensors(BaseModel):
    """What the instruments add; noise is white unless said otherwise, as standard deviations."""

    model_config = _FORBID

    rate_hz: float = Field(
        default=100.0, ge=1, le=10_000, description="of each topic without its own"
    )
    force_noise_N: float = Field(
        default=60.0, ge=0, description="of the total force: (17) over the force share"
    )
    acc_noise_m_s2: float = Field(default=0.01, ge=0, description="of each accelerometer axis")
    speed_noise_m_s: float = Field(default=0.005, ge=0, description="of the mean of both sides")
    gyro_noise_rad_s: float = Field(default=0.001, ge=0, description="of each gyroscope axis")
    pitch_noise_rad: float = Field(default=0.0005, ge=0, description="of the orientation's pitch")
    roll_noise_rad: float = Field(default=0.0, ge=0, description="of the orientation's roll")
    force_drift_N: float = Field(
        default=0.0,
        ge=0,
        description="coloured noise of the total force: a first-order Gauss-Markov process (AR(1))",
    )
    force_drift_s: float = Field(
        default=1.0, gt=0, le=1e5, description="its correlation time: e-folding of autocorrelation"
    )
    acc_bias_m_s2: float = Field(default=0.0, description="of the accelerometer along x")
    gyro_bias_rad_s: float = Field(default=0.0, description="of each gyroscope axis")
    force_bias_N: float = Field(default=0.0, description="of the total force")
    force_gain: float = Field(
        default=1.0, gt=0, le=100, description="the torque sensors report so many times the torque"
    )
    torque_lsb_N_m: float = Field(
        default=0.0, ge=0, description="resolution of each torque sensor; 0: not quantised"
    )
    acc_lsb_m_s2: float = Field(default=0.0, ge=0, description="of each accelerometer axis")
    gyro_lsb_rad_s: float = Field(default=0.0, ge=0, description="of each gyroscope axis")
    speed_lsb_m_s: float = Field(default=0.0, ge=0, description="of each side's wheel speed")
    angle_lsb_rad: float = Field(default=0.0, ge=0, description="of pitch and roll")
    imu_x_m: float = Field(
        default=0.0, ge=-10, le=10, description="where the IMU sits, ahead of the origin"
    )
    imu_y_m: float = Field(default=0.0, ge=-10, le=10, description="and to the left")
    force_delay_s: float = Field(
        default=0.0, ge=0, le=10, description="the torque sensors report what was so long ago"
    )
    speed_delay_s: float = Field(
        default=0.0, ge=0, le=10, description="likewise the wheel speed sensors"
    )
    imu_delay_s: float = Field(default=0.0, ge=0, le=10, description="likewise the IMU")
    seed: int = Field(default=1, ge=0, description="the same seed gives the same logs")


class SimulatedRecorder(BaseModel):
    """How the logs are recorded: one log a load, all on one time line."""

    model_config = _FORBID

    start_unix_s: int = Field(
        default=1_700_000_000, ge=0, le=2_000_000_000, description="when the first log begins"
    )
    machine_id: str = Field(
        default="",
        max_length=64,
        description="serial number in the log's metadata, where it has any (MCAP, rosbag2)",
    )
    load_change_s: float = Field(default=120.0, ge=0, le=86_400, description="between two logs")
    latency_s: float = Field(
        default=0.002, ge=0, le=1, description="least time from measurement to recording"
    )
    latency_jitter_s: float = Field(
        default=0.001, ge=0, le=1, description="what a message may take longer, uniform"
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
        description="mean time between stretches in which nothing is recorded; 0: never",
    )
    blackout_s: float = Field(default=1.0, gt=0, le=3600, description="how long such a stretch is")
