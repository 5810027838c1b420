"""Between motor and ground: limits of the motor, losses, rotating parts, a soft driveline."""

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class SimulatedDrivetrain(BaseModel):
    """Limits of the motor, and what lies between the measured torque and the body."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    power_limit_W: float = Field(
        default=0.0,
        ge=0,
        le=1e8,
        description="the drive force is at most this over the speed; 0: none",
    )
    no_load_speed_m_s: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="speed at which the force of a voltage-limited motor has fallen linearly to "
        "none; 0: it does not fall",
    )
    efficiency: float = Field(
        default=1.0,
        ge=0.1,
        le=1,
        description="share of the measured force that reaches the ground while driving; where the "
        "wheels drive the motor, the share of theirs that is measured",
    )
    rotating_kg: float = Field(
        default=0.0,
        ge=0,
        le=1e5,
        description="equivalent mass of rotating parts, which the measured force accelerates "
        "besides what is weighed",
    )
    gear_up_m_s: tuple[float, ...] = Field(
        default=(), max_length=20, description="speeds at which a gearbox shifts up, ascending"
    )
    gear_rotating_kg: tuple[float, ...] = Field(
        default=(),
        max_length=21,
        description="equivalent mass of what rotates in each gear, besides rotating_kg: one more "
        "than gear_up_m_s",
    )
    resonance_hz: float = Field(
        default=0.0,
        ge=0,
        le=50,
        description="natural frequency of wheels against body over a torsional spring; 0: rigid",
    )
    resonance_damping: float = Field(default=0.1, ge=0, le=2, description="its damping ratio")
    wheel_mass_share: float = Field(
        default=0.1,
        gt=0,
        lt=1,
        description="share of the weighed mass on the wheels' side of that spring",
    )
    relaxation_length_m: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="distance over which the tyres' slip follows their force "
        "(needs machine.slip_stiffness_N)",
    )

    @model_validator(mode="after")
    def _each_gear_has_its_parts(self) -> Self:
        shifts, rotating_kg = self.gear_up_m_s, self.gear_rotating_kg
        if (shifts or rotating_kg) and len(rotating_kg) != len(shifts) + 1:
            raise ValueError(
                f"gear_rotating_kg: {len(rotating_kg)} of {len(shifts) + 1} gears; "
                "give one more than gear_up_m_s"
            )
        if list(shifts) != sorted(set(shifts)) or any(speed <= 0.0 for speed in shifts):
            raise ValueError("gear_up_m_s: give ascending speeds above 0")
        if any(not 0.0 <= mass_kg <= 1e5 for mass_kg in rotating_kg):
            raise ValueError("gear_rotating_kg: a mass is between 0 and 1e5 kg")
        return self
