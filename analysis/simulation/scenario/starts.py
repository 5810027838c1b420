"""What varies from start to start: the driving, and a load that changes between or within them."""

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


class SimulatedLoading(BaseModel):
    """Changes of the load within a log; the truth names the mass of every start."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    change_kg: float = Field(
        default=0.0, ge=-1e6, le=1e6, description="what the load of some starts differs by"
    )
    change_before_start: int = Field(
        default=0,
        ge=0,
        le=100_000,
        description="it changes, standing, before the start of this number (the first is 0); "
        "0: never",
    )
    alternating: bool = Field(
        default=False, description="it changes before every start but the first"
    )
    fill_kg_s: float = Field(
        default=0.0,
        ge=0,
        le=1e5,
        description="rate at which standing material fills the bucket from throttle to braking; "
        "it is emptied when the machine stands",
    )

    spill_1_s: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="part of the load that falls off a second of driving, exponentially; what is "
        "lost stays lost until the load changes",
    )

    def added_kg(self, start: int) -> float:
        """The change of the load at a start of the log, counted from 0."""
        late = 0 < self.change_before_start <= start
        return self.change_kg * float((self.alternating and start % 2 == 1) != late)
