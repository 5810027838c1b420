"""The body of the machine: its known properties, with standard uncertainties."""

from datetime import date
from typing import Annotated, Final, Self
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    PlainSerializer,
    StringConstraints,
    model_validator,
)

from analysis.model.strict_config import STRICT

#: A serial number in the form by which evidence is chained.
MachineId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]


def _require_known_timezone(timezone_name: str) -> str:
    try:
        ZoneInfo(timezone_name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ValueError(
            f"no time zone '{timezone_name}'; use a name like 'America/Santiago' or 'UTC'"
        ) from None
    return timezone_name


#: Name of a time zone that is known here, such as America/Santiago.
KnownTimeZone = Annotated[str, AfterValidator(_require_known_timezone)]


class ImuMounting(BaseModel):
    """How the IMU sits on the machine: roll, pitch, yaw (intrinsic z-y'-x''), and where.

    The standard uncertainty of its place is that of each direction.
    """

    model_config = STRICT

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position_u_m: float | None = Field(default=None, ge=0)


class FuelTank(BaseModel):
    """Fuel on board: litres when the empty machine was weighed, and when the log begins.

    Attributes:
        empty_mass_L: litres in the tank when the empty machine was weighed.
        begin_L: litres in the tank when the log begins.
        rate_L_h: mean rate at which the engine burns fuel, for a log without `fuel_rate_L_h`.
        u_L: standard uncertainty of the difference of both litres.
        density_kg_L: density of the fuel; diesel at 15 °C by EN 590 (0.820 to 0.845).
    """

    model_config = STRICT

    empty_mass_L: float = Field(ge=0)
    begin_L: float = Field(ge=0)
    rate_L_h: float | None = Field(None, ge=0)
    u_L: float = Field(0.0, ge=0)
    density_kg_L: float = Field(0.8325, gt=0.5, lt=1.1)


class Body(BaseModel):
    """Known properties of the machine, with standard uncertainties (`..._u_...`)."""

    model_config = STRICT

    name: str
    #: Serial number, which is compared with that of logs and of evidence.
    #: Not written if it is not given, so that earlier machine files do not change.
    id: MachineId | None = Field(None, exclude_if=lambda value: value is None)
    empty_mass_kg: float | None = Field(None, gt=0)
    empty_mass_u_kg: float | None = Field(None, ge=0)
    #: Date of the weighing, in the machine's time zone.
    empty_mass_day: Annotated[date, PlainSerializer(date.isoformat)] | None = None
    #: Attachment at the weighing, and in this log: bucket, fork.
    #: Not written if not given, like the serial number.
    empty_mass_attachment: str | None = Field(None, exclude_if=lambda value: value is None)
    attachment: str | None = Field(None, exclude_if=lambda value: value is None)
    #: In m: 350 is one in mm.
    wheel_radius_m: float | None = Field(None, gt=0, le=10)
    wheel_radius_u_m: float | None = Field(None, ge=0, le=10)
    #: Standard uncertainty of the relative change of the radius under a load as heavy as the
    #: machine. Not written if not given, like the serial number.
    wheel_radius_by_load_u: float | None = Field(
        None, ge=0, le=1, exclude_if=lambda value: value is None
    )
    track_width_m: float | None = Field(None, gt=0, le=100)
    track_width_u_m: float | None = Field(None, ge=0, le=100)
    force_share: float = Field(1.0, gt=0, le=1)
    force_share_u: float | None = Field(None, ge=0, le=1)
    #: Standard uncertainty of the share's relative change under a load as heavy as the machine.
    force_share_by_load_u: float | None = Field(None, ge=0)
    #: Relative: 5 is one in per cent.
    force_gain_u: float | None = Field(None, ge=0, le=1)
    #: Reading of the force in reverse over that forwards, for the same force.
    #: Not written if not given, like the serial number.
    force_gain_in_reverse: float | None = Field(None, gt=0, exclude_if=lambda value: value is None)
    rotating_mass_kg: float = Field(0.0, ge=0)
    rotating_mass_u_kg: float = Field(0.0, ge=0)
    repeatability_kg: float | None = Field(None, ge=0)
    #: Fraction of a load that is spilled from the bucket between the pile and the dump.
    #: Not written if not given, like the serial number.
    haul_spillage_share: float | None = Field(
        None, ge=0, lt=1, exclude_if=lambda value: value is None
    )
    haul_spillage_u: float | None = Field(None, ge=0, le=1, exclude_if=lambda value: value is None)
    #: Relative standard uncertainty of the fuel rate's channel. Not written if not given.
    fuel_gain_u: float | None = Field(None, ge=0, le=1, exclude_if=lambda value: value is None)
    fuel: FuelTank | None = Field(None, exclude_if=lambda value: value is None)
    #: Whether the machine has a bucket to dig with; without one there are no digging starts.
    digs: bool = True
    gravity_m_s2: float = Field(9.80665, gt=9.7, lt=9.9)
    timezone: KnownTimeZone = "UTC"
    imu: ImuMounting = ImuMounting()

    @model_validator(mode="after")
    def _refuse_inconsistent_attachment(self) -> Self:
        weighed, here = self.empty_mass_attachment, self.attachment
        if weighed is not None and here is not None and weighed != here:
            raise ValueError(
                f"empty_mass_kg is with attachment '{weighed}' (empty_mass_attachment), but the "
                f"machine carries '{here}' (attachment); give the empty mass with '{here}', or "
                "leave empty_mass_kg out"
            )
        return self

    @property
    def wheel_radius_u_1(self) -> float | None:
        """Relative standard uncertainty of the wheel radius; None if it is not stated."""
        if self.wheel_radius_m is None or self.wheel_radius_u_m is None:
            return None
        return self.wheel_radius_u_m / self.wheel_radius_m

    @property
    def empty_inertia_kg(self) -> float | None:
        """Empty mass plus rotating mass, which the force accelerates; None if not stated."""
        return None if self.empty_mass_kg is None else self.empty_mass_kg + self.rotating_mass_kg

    @property
    def time_zone(self) -> ZoneInfo:
        """The time zone in which times are shown."""
        return ZoneInfo(self.timezone)


#: Keys of `[machine]` that arithmetic may name.
BODY_NUMBERS: Final = (
    *("wheel_radius_m", "track_width_m", "gravity_m_s2", "force_share", "empty_mass_kg"),
)
