"""Drivetrain, brakes and rolling resistance between motor and ground, and the sprung body."""

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class SimulatedDrivetrain(BaseModel):
    """Limits of the motor, and what lies between the measured torque and the body."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    power_limit_W: float = Field(
        default=0.0,
        ge=0,
        le=1e8,
        description="power limit: drive force at most this over the speed; 0: no limit",
    )
    no_load_speed_m_s: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="speed at which the force of a voltage-limited motor has fallen linearly "
        "to 0; 0: no such limit",
    )
    efficiency: float = Field(
        default=1.0,
        ge=0.1,
        le=1,
        description="share of the measured force that reaches the ground in driving; when the "
        "wheels drive the motor, share of their force that is measured",
    )
    rotating_kg: float = Field(
        default=0.0,
        ge=0,
        le=1e5,
        description="equivalent mass of rotating parts, which the measured force accelerates "
        "in addition to the weighed mass",
    )
    gear_up_m_s: tuple[float, ...] = Field(
        default=(), max_length=20, description="speeds at which a gearbox shifts up, ascending"
    )
    gear_rotating_kg: tuple[float, ...] = Field(
        default=(),
        max_length=21,
        description="equivalent rotating mass in each gear, in addition to rotating_kg: one "
        "value more than gear_up_m_s",
    )
    resonance_hz: float = Field(
        default=0.0,
        ge=0,
        le=50,
        description="natural frequency of wheels against body over a torsional spring; 0: rigid",
    )
    resonance_damping: float = Field(
        default=0.1, ge=0, le=2, description="damping ratio of wheels against body"
    )
    wheel_mass_share: float = Field(
        default=0.1,
        gt=0,
        lt=1,
        description="share of the weighed mass on the wheel side of the torsional spring",
    )
    relaxation_length_m: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="distance over which the tyres' slip follows their force "
        "(needs machine.slip_stiffness_N)",
    )

    @model_validator(mode="after")
    def _refuse_inconsistent_gears(self) -> Self:
        shifts, rotating_kg = self.gear_up_m_s, self.gear_rotating_kg
        if (shifts or rotating_kg) and len(rotating_kg) != len(shifts) + 1:
            raise ValueError(
                f"gear_rotating_kg: has the masses of {len(rotating_kg)} of {len(shifts) + 1} "
                "gears; give one mass per gear, which is one more than gear_up_m_s has speeds"
            )
        if list(shifts) != sorted(set(shifts)) or any(speed <= 0.0 for speed in shifts):
            raise ValueError("gear_up_m_s: give ascending speeds above 0")
        if any(not 0.0 <= mass_kg <= 1e5 for mass_kg in rotating_kg):
            raise ValueError("gear_rotating_kg: each mass must be between 0 and 1e5 kg")
        return self


class SimulatedBrakes(BaseModel):
    """Friction of the brakes that the torque sensors do not measure."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    drag_N: float = Field(default=0.0, ge=0, le=1e6, description="constant drag of the brakes")
    release_s: float = Field(
        default=0.0,
        ge=0,
        le=60,
        description="time constant of the release of the brakes at the beginning of a start; "
        "0: at once",
    )
    release_N: float = Field(
        default=2000.0, ge=0, le=1e6, description="drag of the brakes as their release begins"
    )
    gentle_m_s2: float = Field(
        default=0.0,
        ge=0,
        le=5,
        description="deceleration by brakes that no force sensor measures, in addition to "
        "friction, until the machine stands; above 0 it replaces campaign.braking_m_s2, "
        "at 0 campaign.braking_m_s2 applies",
    )
    gentle_lead_s: float = Field(
        default=0.5,
        ge=0,
        le=60,
        description="time by which the unmeasured brakes act before the cruise ends",
    )


class SimulatedChassis(BaseModel):
    """Pitching of the body, and the reaction of a boom that moves to and fro."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    squat_deg_s2_m: float = Field(
        default=0.0, ge=-10, le=10, description="pitch, nose up, over forward acceleration"
    )
    squat_deg_s2_m_kg: float = Field(
        default=0.0,
        ge=-0.1,
        le=0.1,
        description="increase of squat_deg_s2_m per kg of load: soft rear springs",
    )
    pitch_deg_kg: float = Field(
        default=0.0,
        ge=-0.1,
        le=0.1,
        description="pitch, nose up, over the load, standing or driving",
    )
    squat_hz: float = Field(
        default=0.0,
        ge=0,
        le=50,
        description="natural frequency of the pitching; 0: the pitch follows at once",
    )
    squat_damping: float = Field(
        default=0.3, ge=0, le=5, description="damping ratio of the pitching"
    )
    boom_kg: float = Field(
        default=0.0,
        ge=0,
        le=1e5,
        description="mass of the part of the machine that moves with a boom",
    )
    boom_stroke_m: float = Field(
        default=0.2,
        ge=0,
        le=10,
        description="peak-to-peak motion of boom_kg, fore and aft, a sine",
    )
    boom_period_s: float = Field(
        default=4.0, ge=0.1, le=1000, description="period of the motion of boom_kg"
    )


class SimulatedRolling(BaseModel):
    """Rolling resistance along the way; where the machine stands it grips as Coulomb friction."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    coefficient: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="resistance in straight, slow driving over the weight with load",
    )
    second_ground_more: float = Field(
        default=0.0,
        ge=-0.5,
        le=0.5,
        description="increase of the coefficient on a second ground, which alternates with the "
        "first along the way",
    )
    ground_length_m: float = Field(
        default=15.0,
        ge=2.5,
        le=10_000,
        description="length of each ground; the first begins where a log or a shift begins",
    )
    growth_s_m: float = Field(
        default=0.0, ge=0, le=1, description="relative increase of the coefficient per m/s of speed"
    )
    growth_s_rad: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="relative increase of the coefficient per rad/s of yaw rate",
    )

    @model_validator(mode="after")
    def _refuse_inconsistent_ground(self) -> Self:
        if self.coefficient + self.second_ground_more < 0.0:
            raise ValueError(
                "'second_ground_more' makes the second ground's coefficient negative; give at "
                f"least {-self.coefficient:g}"
            )
        return self

    @property
    def highest_coefficient(self) -> float:
        """Rolling resistance coefficient of the ground with the higher resistance."""
        return self.coefficient + max(self.second_ground_more, 0.0)
