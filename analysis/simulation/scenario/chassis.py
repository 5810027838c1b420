"""The body on its springs: it squats as it accelerates, and a boom moves on it."""

from pydantic import BaseModel, ConfigDict, Field


class SimulatedChassis(BaseModel):
    """Pitching of the body, and the reaction of a boom that moves to and fro."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    squat_deg_s2_m: float = Field(
        default=0.0, ge=-10, le=10, description="pitch, nose up, over forward acceleration"
    )
    squat_deg_s2_m_kg: float = Field(
        default=0.0, ge=-0.1, le=0.1, description="what it is more a kg of load: soft rear springs"
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
        description="natural frequency of that pitching; 0: it follows at once",
    )
    squat_damping: float = Field(default=0.3, ge=0, le=5, description="its damping ratio")
    boom_kg: float = Field(
        default=0.0, ge=0, le=1e5, description="mass, part of the machine's, that moves with a boom"
    )
    boom_stroke_m: float = Field(
        default=0.2, ge=0, le=10, description="how far it goes ahead and back, as a sine"
    )
    boom_period_s: float = Field(
        default=4.0, ge=0.1, le=1000, description="and how long that takes"
    )
