"""Starts that differ from each other, and drivers that do not hold stick or wheel still."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class SimulatedStarts(BaseModel):
    """What differs from start to start, drawn from the seed, and how a start is steered."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    throttle_least: float = Field(
        default=1.0, gt=0, le=1, description="each start has a share of its throttle, at least this"
    )
    throttle_most: float = Field(default=1.0, gt=0, le=1, description="and at most this, uniform")
    directions: Literal["as listed", "alternating"] = Field(
        default="as listed", description="alternating: every second start goes the other way"
    )
    coulomb_std_N: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        description="of the Coulomb friction from start to start, normal, none below 0",
    )
    stick_share: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="part of the throttle by which the stick swings back and forth",
    )
    stick_hz: float = Field(default=0.7, gt=0, le=50, description="how often it swings, as a sine")
    turn_rad_s: float = Field(
        default=0.0, ge=-1, le=1, description="yaw rate of a start, reached above 0.1 m/s"
    )
    scrub_N_s_rad: float = Field(
        default=5000.0,
        ge=0,
        le=1e7,
        description="resistance of scrubbing tyres over the yaw rate of such a start",
    )

    @model_validator(mode="after")
    def _throttle_is_a_range(self) -> Self:
        if self.throttle_least > self.throttle_most:
            raise ValueError("'throttle_least' is above 'throttle_most'")
        return self
