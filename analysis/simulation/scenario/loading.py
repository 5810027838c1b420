"""A load that changes within a log: between starts, or while the machine drives."""

from pydantic import BaseModel, ConfigDict, Field


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
