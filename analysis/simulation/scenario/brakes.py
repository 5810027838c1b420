"""Brakes that drag, release slowly at a start, or stop the machine gently; no sensor sees it."""

from pydantic import BaseModel, ConfigDict, Field


class SimulatedBrakes(BaseModel):
    """Friction of the brakes that the torque sensors do not see."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    drag_N: float = Field(default=0.0, ge=0, le=1e6, description="drag throughout")
    release_s: float = Field(
        default=0.0,
        ge=0,
        le=60,
        description="time constant with which they let go from a start's beginning; 0: at once",
    )
    release_N: float = Field(
        default=2000.0, ge=0, le=1e6, description="drag with which such a release begins"
    )
    gentle_m_s2: float = Field(
        default=0.0,
        ge=0,
        le=5,
        description="deceleration that brakes no force sensor sees add to friction's, down to the "
        "stand, in place of campaign.braking_m_s2; 0: those",
    )
    gentle_lead_s: float = Field(
        default=0.5,
        ge=0,
        le=60,
        description="how long before the throttle is shut these begin, within the cruise",
    )
