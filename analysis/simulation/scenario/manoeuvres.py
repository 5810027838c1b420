"""Manoeuvres of the machine, each from standstill to standstill, except a travel."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, model_validator

from analysis.simulation.scenario.waveforms import ForceWave, TorqueWave


class _Manoeuvre(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Rest(_Manoeuvre):
    """Stand, held by the brakes."""

    kind: Literal["rest"] = "rest"
    duration_s: float = Field(default=5.0, ge=0, le=3600, description="duration of the standstill")


class Start(_Manoeuvre):
    """Straight ahead or back: throttle, cruise, brake to a stop. The heading is kept."""

    kind: Literal["start"] = "start"
    direction: Literal["forward", "reverse"] = Field(
        default="forward", description="forward or reverse"
    )
    throttle: float = Field(default=1.0, gt=0, le=1, description="share of the full throttle")
    start_s: float = Field(default=3.0, ge=0.001, le=600, description="duration of open throttle")
    cruise_s: float = Field(
        default=2.0,
        ge=0.001,
        le=600,
        description="duration of cruise, with the throttle that keeps the speed",
    )
    coast_s: float = Field(
        default=0.0,
        ge=0,
        le=600,
        description="duration of coasting with shut throttle and open brakes, before braking",
    )
    digging_N: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        description="resistance that grows from 0 until the throttle is shut, and then stays",
    )
    digging_s: float = Field(
        default=1.0, gt=0, le=600, description="time in which the resistance grows"
    )


class Spin(_Manoeuvre):
    """Turn on the spot: throttle, hold the rate, brake. The origin stays where it is."""

    kind: Literal["spin"] = "spin"
    direction: Literal["left", "right"] = Field(default="left", description="left or right")
    throttle: float = Field(
        default=1.0, gt=0, le=1, description="share of the full throttle of both sides"
    )
    start_s: float = Field(default=3.0, ge=0.001, le=600, description="duration of open throttle")
    cruise_s: float = Field(
        default=2.0,
        ge=0.001,
        le=600,
        description="duration of cruise, with the throttle that keeps the yaw rate",
    )


class Arc(_Manoeuvre):
    """An arc at constant speed and yaw rate, with smooth ramps to and from a standstill."""

    kind: Literal["arc"] = "arc"
    speed_m_s: float = Field(ge=-50, le=50, description="speed held, negative backwards")
    yaw_rate_rad_s: float = Field(ge=-10, le=10, description="yaw rate held, positive to the left")
    duration_s: float = Field(
        default=10.0, ge=0.001, le=3600, description="duration of constant speed and yaw rate"
    )
    ramp_s: float = Field(
        default=4.0,
        ge=0.1,
        le=600,
        description="duration of the ramp from standstill to the arc, and back",
    )


class Excite(_Manoeuvre):
    """Drive force, yaw torque or both follow waveforms; then brake to a stop.

    With a force alone the heading is kept, with a torque alone the origin's place; with both the
    machine goes where they take it.
    """

    kind: Literal["excite"] = "excite"
    duration_s: float = Field(default=60.0, ge=0.001, le=3600, description="duration of the drive")
    force: ForceWave | None = Field(default=None, description="waveform of the drive force")
    torque: TorqueWave | None = Field(default=None, description="waveform of the yaw torque")

    @model_validator(mode="after")
    def _refuse_missing_waveforms(self) -> Self:
        if self.force is None and self.torque is None:
            raise ValueError("an excitation needs 'force', 'torque' or both")
        return self


class Travel(_Manoeuvre):
    """Drive straight ahead at speeds held for a while each, possibly with standstills between.

    The pedal follows the difference to the speed that is wanted.
    """

    kind: Literal["travel"] = "travel"
    duration_s: float = Field(default=300.0, gt=0, le=3600, description="duration of the drive")
    speed_least_m_s: float = Field(default=5.0, gt=0, le=50, description="lowest speed held")
    speed_most_m_s: float = Field(default=15.0, gt=0, le=50, description="highest speed held")
    hold_least_s: float = Field(default=4.0, gt=0, le=3600, description="shortest time at a speed")
    hold_most_s: float = Field(default=12.0, gt=0, le=3600, description="longest time at a speed")
    acceleration_m_s2: float = Field(
        default=1.0, gt=0, le=20, description="acceleration from one held speed to the next"
    )
    response_s: float = Field(
        default=0.5,
        ge=0.01,
        le=10,
        description="response time of the pedal: it commands mass times speed error over this time",
    )
    stop_share: float = Field(
        default=0.3, ge=0, le=1, description="fraction of the held speeds that end in a stop"
    )
    stand_least_s: float = Field(default=1.0, ge=0, le=3600, description="shortest stop")
    stand_most_s: float = Field(default=5.0, ge=0, le=3600, description="longest stop")
    to_and_fro: bool = Field(
        default=False, description="after each stop the machine drives back the way it came"
    )
    motor_brakes: bool = Field(
        default=False,
        description="the motor brakes the machine, and the force sensors measure all of it",
    )
    in_motion: bool = Field(default=False, description="the log begins and ends in motion")

    @model_validator(mode="after")
    def _refuse_reversed_ranges(self) -> Self:
        for least, most in (
            ("speed_least_m_s", "speed_most_m_s"),
            ("hold_least_s", "hold_most_s"),
            ("stand_least_s", "stand_most_s"),
        ):
            if getattr(self, least) > getattr(self, most):
                raise ValueError(f"{least!r} is greater than {most!r}; correct one of them")
        return self


Manoeuvre: TypeAlias = Annotated[
    Rest | Start | Spin | Arc | Excite | Travel, Field(discriminator="kind")
]
