"""What a simulation is asked for: a scenario. Its defaults are the paper's campaign."""

import math
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

_FORBID = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
#: No loader is faster: beyond it a scenario is a slip of the pen, and a stop takes forever.
_TOP_SPEED_M_S = 50.0


class SimulatedMachine(BaseModel):
    """The machine without load. Mass and friction are the paper's; the rest is assumed."""

    model_config = _FORBID

    mass_kg: float = Field(default=3614.0, gt=0, le=1e6)
    friction_N_s_m: float = Field(default=2891.0, ge=0, le=1e6)
    coulomb_N: float = Field(default=0.0, ge=0, le=1e6)
    wheel_radius_m: float = Field(default=0.42, gt=0, le=10)
    track_width_m: float = Field(default=1.5, gt=0, le=10)
    force_share: float = Field(
        default=0.5, gt=0, le=1, description="share of the force on the wheels with torque sensors"
    )


class SimulatedCampaign(BaseModel):
    """Loads, runs a load, and what one run is: stand, full throttle, cruise, brake."""

    model_config = _FORBID

    loads_kg: tuple[float, ...] = Field(
        default=(0.0, 50.0, 100.0, 150.0, 200.0, 250.0), min_length=1, max_length=100
    )
    runs: int = Field(default=9, ge=1, le=1000)
    standstill_s: float = Field(default=5.0, ge=0, le=600)
    start_s: float = Field(default=3.0, ge=0.001, le=600, description="full throttle")
    cruise_s: float = Field(
        default=2.0, ge=0.001, le=600, description="throttle reduced to what keeps the speed"
    )
    throttle_force_N: float = Field(default=6000.0, gt=0, le=1e7)
    valve_lag_s: float = Field(
        default=0.08, ge=0.001, le=10, description="first-order lag of drive and brakes"
    )
    braking_m_s2: float = Field(
        default=1.5, gt=0, le=20, description="deceleration that the brakes add to friction's"
    )
    brake_measured_share: float = Field(
        default=0.4, ge=0, le=1, description="share of the braking force that the sensors see"
    )
    rest_s: float = Field(default=5.0, ge=0, le=600, description="standstill after the last run")

    @field_validator("loads_kg")
    @classmethod
    def _loads_can_be_told_apart(cls, loads: tuple[float, ...]) -> tuple[float, ...]:
        if any(not 0 <= load <= 1e6 for load in loads):
            raise ValueError("a load is between 0 and 1e6 kg")
        if len(set(loads)) < len(loads):
            raise ValueError("a load appears twice; raise 'runs' to repeat it")
        return loads


class SimulatedTerrain(BaseModel):
    """The ground under the whole campaign."""

    model_config = _FORBID

    slope_deg: float = Field(default=0.0, ge=-30, le=30, description="positive drives uphill")
    gravity_m_s2: float = Field(default=9.80665, gt=9.7, lt=9.9)

    @property
    def slope_rad(self) -> float:
        """The slope, and with it the pitch: positive nose-up."""
        return math.radians(self.slope_deg)


class SimulatedSensors(BaseModel):
    """What the instruments add: standard deviations of white noise a sample, delay, bias."""

    model_config = _FORBID

    rate_hz: float = Field(default=100.0, ge=1, le=10_000, description="of each topic")
    force_noise_N: float = Field(
        default=60.0, ge=0, description="of the total force: (17) over the force share"
    )
    acc_noise_m_s2: float = Field(default=0.01, ge=0, description="of each accelerometer axis")
    speed_noise_m_s: float = Field(default=0.005, ge=0, description="of the mean of both sides")
    gyro_noise_rad_s: float = Field(default=0.001, ge=0, description="of each gyroscope axis")
    pitch_noise_rad: float = Field(default=0.0005, ge=0, description="of the orientation's pitch")
    acc_bias_m_s2: float = Field(default=0.0, description="of the accelerometer along x")
    force_delay_s: float = Field(
        default=0.0, ge=0, le=10, description="the torque sensors report what was so long ago"
    )
    seed: int = Field(default=1, ge=0)


class SimulatedRecorder(BaseModel):
    """How the logs are recorded: one log a load, all on one time line."""

    model_config = _FORBID

    start_unix_s: int = Field(default=1_700_000_000, ge=0, le=2_000_000_000)
    load_change_s: float = Field(default=120.0, ge=0, le=86_400, description="between two logs")
    latency_s: float = Field(
        default=0.002, ge=0, le=1, description="least time from measurement to recording"
    )
    latency_jitter_s: float = Field(
        default=0.001, ge=0, le=1, description="what a message may take longer, uniform"
    )


class Scenario(BaseModel):
    """A whole scenario file."""

    model_config = _FORBID

    machine: SimulatedMachine = SimulatedMachine()
    campaign: SimulatedCampaign = SimulatedCampaign()
    terrain: SimulatedTerrain = SimulatedTerrain()
    sensors: SimulatedSensors = SimulatedSensors()
    log: SimulatedRecorder = SimulatedRecorder()

    @model_validator(mode="after")
    def _the_machine_starts_and_stops(self) -> Self:
        campaign, machine = self.campaign, self.machine
        heaviest_kg = machine.mass_kg + max(campaign.loads_kg)
        lightest_kg = machine.mass_kg + min(campaign.loads_kg)
        downhill_m_s2 = self.terrain.gravity_m_s2 * math.sin(self.terrain.slope_rad)
        resistance_N = machine.coulomb_N + heaviest_kg * downhill_m_s2
        reached_N = campaign.throttle_force_N * -math.expm1(
            -campaign.start_s / campaign.valve_lag_s
        )
        if reached_N <= resistance_N:
            raise ValueError(
                f"campaign.throttle_force_N: reaches {reached_N:.0f} N in campaign.start_s, but "
                f"slope and Coulomb friction hold {heaviest_kg:g} kg with {resistance_N:.0f} N"
            )
        push_N = campaign.throttle_force_N - machine.coulomb_N - lightest_kg * downhill_m_s2
        if push_N > _TOP_SPEED_M_S * max(machine.friction_N_s_m, lightest_kg / campaign.start_s):
            raise ValueError(
                f"campaign.throttle_force_N: drives the machine beyond {_TOP_SPEED_M_S:g} m/s "
                "in campaign.start_s"
            )
        if campaign.braking_m_s2 + downhill_m_s2 < 0.1:
            raise ValueError(
                f"campaign.braking_m_s2: {campaign.braking_m_s2:g} does not stop the machine on "
                f"this slope; give at least {0.1 - downhill_m_s2:.2f}"
            )
        if self.log.latency_jitter_s * self.sensors.rate_hz >= 1:
            raise ValueError(
                "log.latency_jitter_s: must be shorter than a period of sensors.rate_hz, "
                "so that messages are recorded in order"
            )
        return self
