"""The scenario of a simulation; its defaults are the paper's campaign.

Values are checked one by one here; whether the machine can be driven as requested is checked by
`limits` in the simulation.
"""

import math
from typing import Literal, Self, overload

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from analysis.simulation.scenario.drivetrain import (
    SimulatedBrakes,
    SimulatedChassis,
    SimulatedDrivetrain,
    SimulatedRolling,
)
from analysis.simulation.scenario.instruments import (
    SimulatedDefects,
    SimulatedRecorder,
    SimulatedSampling,
    SimulatedSensors,
)
from analysis.simulation.scenario.manoeuvres import Manoeuvre, Rest, Start
from analysis.simulation.scenario.shift_plan import SimulatedShift
from estimators.arrays import Floats

_FORBID = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SimulatedStarts(BaseModel):
    """What differs from start to start, drawn from the seed, and how a start is steered."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    throttle_least: float = Field(
        default=1.0, gt=0, le=1, description="smallest share of the throttle in a start"
    )
    throttle_most: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="largest share of the throttle in a start, uniformly distributed",
    )
    directions: Literal["as listed", "alternating"] = Field(
        default="as listed", description="alternating: every second start reverses its direction"
    )
    coulomb_std_N: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        description="standard deviation of the Coulomb friction between starts, normal, cut "
        "off at 0",
    )
    stick_share: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="largest reduction of the throttle by an oscillating stick, as a share of it",
    )
    stick_hz: float = Field(
        default=0.7, gt=0, le=50, description="frequency of the stick, which oscillates as a sine"
    )
    turn_rad_s: float = Field(
        default=0.0, ge=-1, le=1, description="yaw rate of a start, reached above 0.1 m/s"
    )
    scrub_N_s_rad: float = Field(
        default=5000.0,
        ge=0,
        le=1e7,
        description="resistance of scrubbing tyres per yaw rate, in a start that turns",
    )

    @model_validator(mode="after")
    def _refuse_reversed_throttle_range(self) -> Self:
        if self.throttle_least > self.throttle_most:
            raise ValueError("'throttle_least' is above 'throttle_most'; correct one of them")
        return self


class SimulatedLoading(BaseModel):
    """Changes of the load within a log; the truth names the mass of every start."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    change_kg: float = Field(
        default=0.0, ge=-1e6, le=1e6, description="change of the load between starts"
    )
    change_before_start: int = Field(
        default=0,
        ge=0,
        le=100_000,
        description="number of the start (the first is 0) before which the load changes at "
        "standstill; 0: never",
    )
    alternating: bool = Field(
        default=False, description="the load changes before every start but the first"
    )
    fill_kg_s: float = Field(
        default=0.0,
        ge=0,
        le=1e5,
        description="rate at which loose material fills the bucket while driving, up to braking; "
        "the bucket is emptied when the machine stands",
    )

    spill_1_s: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="part of the load that falls off per second of driving, exponentially; what "
        "is lost stays lost until the load changes",
    )

    def added_load_kg(self, start_index: int) -> float:
        """Change of the load in kg at a start of the log; starts count from 0."""
        late = 0 < self.change_before_start <= start_index
        return self.change_kg * float((self.alternating and start_index % 2 == 1) != late)


class SimulatedMachine(BaseModel):
    """The machine without load. Mass and friction are the paper's; the rest is assumed.

    The origin lies midway between the wheels, where wheels that do not slip sideways allow no
    sideways motion.
    """

    model_config = _FORBID

    mass_kg: float = Field(default=3614.0, gt=0, le=1e6, description="mass without load")
    friction_N_s_m: float = Field(
        default=2891.0, ge=0, le=1e6, description="viscous friction of driving"
    )
    coulomb_N: float = Field(default=0.0, ge=0, le=1e6, description="Coulomb friction of driving")
    air_N_s2_m2: float = Field(
        default=0.0, ge=0, le=1e5, description="air resistance over the square of the speed"
    )
    spring_N_m: float = Field(
        default=0.0,
        ge=0,
        le=1e7,
        description="stiffness of a spring, as in a test rack, that pulls the machine back to "
        "where a log begins",
    )
    friction_warming: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of the viscous friction that a warm machine has lost; logs and "
        "shifts begin cold",
    )
    coulomb_warming: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of the Coulomb friction that a warm machine has lost",
    )
    warming_s: float = Field(
        default=60.0, gt=0, le=1e5, description="time constant of the warm-up of both frictions"
    )
    inertia_z_kg_m2: float = Field(
        default=4000.0, gt=0, le=1e7, description="yaw inertia about the origin"
    )
    com_x_m: float = Field(
        default=0.0, ge=-10, le=10, description="centre of mass ahead of the origin"
    )
    com_y_m: float = Field(default=0.0, ge=-10, le=10, description="centre of mass to the left")
    friction_z_N_m_s: float = Field(
        default=5000.0, ge=0, le=1e7, description="viscous friction of turning"
    )
    coulomb_z_N_m: float = Field(
        default=0.0, ge=0, le=1e7, description="Coulomb friction of turning"
    )
    slip_stiffness_N: float = Field(
        default=0.0,
        ge=0,
        le=1e9,
        description="longitudinal slip stiffness of all wheels: slip is force over stiffness; "
        "0: no slip",
    )
    load_x_m: float = Field(
        default=1.5, ge=-10, le=10, description="position of the load ahead of the origin"
    )
    load_y_m: float = Field(
        default=0.0, ge=-10, le=10, description="position of the load to the left of the origin"
    )
    wheel_radius_m: float = Field(
        default=0.42, gt=0, le=10, description="wheel radius, as a machine file gives it"
    )
    wheel_radius_excess: float = Field(
        default=0.0,
        ge=-0.5,
        le=0.5,
        description="relative excess of the true wheel radius over wheel_radius_m, for torque "
        "and speed",
    )
    track_width_m: float = Field(
        default=1.5, gt=0, le=10, description="distance between the wheels of both sides"
    )
    force_share: float = Field(
        default=0.5, gt=0, le=1, description="share of the force on the wheels with torque sensors"
    )


class SimulatedCampaign(BaseModel):
    """Loads, runs per load, and the phases of a run: stand, full throttle, cruise, brake."""

    model_config = _FORBID

    loads_kg: tuple[float, ...] = Field(
        default=(0.0, 50.0, 100.0, 150.0, 200.0, 250.0),
        min_length=1,
        max_length=100,
        description="loads in the bucket, one log for each",
    )
    runs: int = Field(default=9, ge=1, le=1000, description="runs with each load")
    standstill_s: float = Field(default=5.0, ge=0, le=600, description="standstill before a start")
    start_s: float = Field(
        default=3.0,
        ge=0.001,
        le=600,
        description="duration of full throttle, unless manoeuvres set it",
    )
    cruise_s: float = Field(
        default=2.0,
        ge=0.001,
        le=600,
        description="duration of cruise, with the throttle that keeps the speed",
    )
    throttle_force_N: float = Field(
        default=6000.0, gt=0, le=1e7, description="drive force of full throttle"
    )
    valve_lag_s: float = Field(
        default=0.08, ge=0.001, le=10, description="time constant of the lag of drive and brakes"
    )
    braking_m_s2: float = Field(
        default=1.5, gt=0, le=20, description="deceleration by the brakes, in addition to friction"
    )
    brake_measured_share: float = Field(
        default=0.4, ge=0, le=1, description="share of the braking force that the sensors measure"
    )
    valve_deadband_share: float = Field(
        default=0.0, ge=0, lt=1, description="share of the throttle that the valves ignore"
    )
    rest_s: float = Field(default=5.0, ge=0, le=600, description="standstill after the last run")
    manoeuvres: tuple[Manoeuvre, ...] = Field(
        default=(), max_length=100, description="manoeuvres of a run; none: a rest and a start"
    )

    @property
    def manoeuvres_of_trial(self) -> tuple[Manoeuvre, ...]:
        """The manoeuvres of one trial (a run of the scenario)."""
        start = Start(start_s=self.start_s, cruise_s=self.cruise_s)
        return self.manoeuvres or (Rest(duration_s=self.standstill_s), start)

    def drive_fraction_at_throttle(self, throttle_fraction: float) -> float:
        """Fraction of full drive force at a fraction of full throttle, in steady state.

        0 within the dead band, then linear up to 1 at full throttle.
        """
        opened = max(abs(throttle_fraction) - self.valve_deadband_share, 0.0)
        return math.copysign(opened / (1.0 - self.valve_deadband_share), throttle_fraction)

    @field_validator("loads_kg")
    @classmethod
    def _refuse_equal_loads(cls, loads: tuple[float, ...]) -> tuple[float, ...]:
        if any(not 0 <= load <= 1e6 for load in loads):
            raise ValueError("each load must be between 0 and 1e6 kg")
        if len(set(loads)) < len(loads):
            repeated = next(load for load in loads if loads.count(load) > 1)
            raise ValueError(
                f"{repeated:g} kg appears twice; give each load once, and raise 'runs' to repeat "
                "them all"
            )
        return loads


class SimulatedTerrain(BaseModel):
    """The ground under the whole campaign."""

    model_config = _FORBID

    slope_deg: float = Field(
        default=0.0, ge=-30, le=30, description="slope of the ground, positive uphill ahead"
    )
    hills_deg: float = Field(
        default=0.0,
        ge=0,
        le=20,
        description="amplitude of hills: the slope varies as a sine along the way",
    )
    hills_length_m: float = Field(
        default=20.0, ge=1, le=10_000, description="distance from hill to hill"
    )
    hills_phase_deg: float = Field(
        default=0.0, ge=-360, le=360, description="phase of the hills where a log begins"
    )
    gravity_m_s2: float = Field(default=9.80665, gt=9.7, lt=9.9, description="local gravity")

    @property
    def slope_rad(self) -> float:
        """Slope without hills, and so the pitch, in rad; positive nose-up."""
        return math.radians(self.slope_deg)

    @property
    def hill_wavenumber_rad_m(self) -> float:
        """Wavenumber of the hills along the way, in rad/m."""
        return 2.0 * math.pi / self.hills_length_m

    @overload
    def compute_slope_rad(self, position_m: float) -> float: ...
    @overload
    def compute_slope_rad(self, position_m: Floats) -> Floats: ...
    def compute_slope_rad(self, position_m: float | Floats) -> float | Floats:
        """Slope in rad at one or (n,) positions in m, counted from where a log begins."""
        phase = self.hill_wavenumber_rad_m * position_m + math.radians(self.hills_phase_deg)
        return self.slope_rad + math.radians(self.hills_deg) * np.sin(phase)

    def slope_gradient_rad_m(self, position_m: Floats) -> Floats:
        """Change of the slope per metre along the way, in rad/m, at positions (n,)."""
        phase = self.hill_wavenumber_rad_m * position_m + math.radians(self.hills_phase_deg)
        return math.radians(self.hills_deg) * self.hill_wavenumber_rad_m * np.cos(phase)


class Scenario(BaseModel):
    """A whole scenario file."""

    model_config = _FORBID

    machine: SimulatedMachine = SimulatedMachine()
    campaign: SimulatedCampaign = SimulatedCampaign()
    terrain: SimulatedTerrain = SimulatedTerrain()
    rolling: SimulatedRolling = SimulatedRolling()
    drivetrain: SimulatedDrivetrain = SimulatedDrivetrain()
    chassis: SimulatedChassis = SimulatedChassis()
    brakes: SimulatedBrakes = SimulatedBrakes()
    starts: SimulatedStarts = SimulatedStarts()
    loading: SimulatedLoading = SimulatedLoading()
    sensors: SimulatedSensors = SimulatedSensors()
    sampling: SimulatedSampling = SimulatedSampling()
    defects: SimulatedDefects = SimulatedDefects()
    log: SimulatedRecorder = SimulatedRecorder()
    shift: SimulatedShift | None = None

    def copy_with_seed(self, seed: int) -> Self:
        """Copy the scenario with another seed, and so with other noise."""
        sensors = self.sensors.model_copy(update={"seed": seed})
        return self.model_copy(update={"sensors": sensors})

    @property
    def full_throttle_force_and_torque(self) -> tuple[float, float]:
        """Force in N of both sides at full throttle, and their torque in N·m in opposition."""
        full_N = self.campaign.throttle_force_N
        return full_N, full_N * self.machine.track_width_m / 2.0

    def limit_force_and_torque_to_valves(
        self, force_N: float, torque_N_m: float
    ) -> tuple[float, float]:
        """Force in N and torque in N·m that the valves of both sides allow, without their lag."""
        width_m, full_N = self.machine.track_width_m, self.campaign.throttle_force_N / 2.0
        valve, turning_N = self.campaign.drive_fraction_at_throttle, torque_N_m / width_m
        left = full_N * valve((force_N / 2.0 - turning_N) / full_N)
        right = full_N * valve((force_N / 2.0 + turning_N) / full_N)
        return left + right, (right - left) * width_m / 2.0
