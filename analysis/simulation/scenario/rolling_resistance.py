"""Rolling resistance of the wheels: in proportion to the weight of the machine with its load."""

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class SimulatedRolling(BaseModel):
    """Rolling resistance along the way; where the machine stands it grips as Coulomb friction."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    coefficient: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="resistance of a slow machine that goes straight, over its weight with load",
    )
    second_ground_more: float = Field(
        default=0.0,
        ge=-0.5,
        le=0.5,
        description="what the coefficient is more on a second ground, which alternates with the "
        "first along the way",
    )
    ground_length_m: float = Field(
        default=15.0,
        ge=2.5,
        le=10_000,
        description="length of each of both; the first begins where a log or a shift begins",
    )
    growth_s_m: float = Field(
        default=0.0, ge=0, le=1, description="part by which it grows a m/s of speed"
    )
    growth_s_rad: float = Field(
        default=0.0, ge=0, le=100, description="part by which it grows a rad/s of yaw rate"
    )

    @model_validator(mode="after")
    def _no_ground_drives(self) -> Self:
        if self.coefficient + self.second_ground_more < 0.0:
            raise ValueError("'second_ground_more' leaves a coefficient below 0")
        return self

    @property
    def highest(self) -> float:
        """The coefficient of the heavier ground."""
        return self.coefficient + max(self.second_ground_more, 0.0)
