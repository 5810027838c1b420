"""When each topic is sampled, and what its clock makes of it."""

from typing import Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

TopicName: TypeAlias = Literal["imu", "torque", "speed", "boom", "odometry", "gnss"]


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

    def clock_ppm(self, topic: TopicName) -> float:
        """Rate error of a topic's clock in ppm; positive if it runs fast."""
        clocks: dict[str, float] = {
            "imu": self.imu_clock_ppm,
            "torque": self.torque_clock_ppm,
            "speed": self.speed_clock_ppm,
        }
        return clocks.get(topic, 0.0)
