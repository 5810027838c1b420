"""The machine: its body, its channels and its settings, as a machine file states them."""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, Self

from pydantic import (
    BaseModel,
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from analysis.expressions.parse import (
    Expression,
    ExpressionError,
    iter_channel_names,
    iter_differentiated_channels,
    parse_expression,
)
from analysis.model.machine_body import BODY_NUMBERS, Body, KnownTimeZone
from analysis.model.model_limits import LIMITS
from analysis.model.physical_units import get_unit_registry, split_unit_from_name
from analysis.model.schema import CHANNEL_COLUMNS
from analysis.model.settings import Settings
from analysis.model.strict_config import STRICT
from estimators.errors import suggest_choice

# TOML allows nan and inf, which are not valid as a scale, delay or length
_DERIVATIVE = re.compile(r"d/dt\s+(\w+)")
_MEAN = re.compile(r"mean\(\s*(\w+)\s*,\s*(\w+)\s*\)")
#: Channels of wheel speed: if read in rad/s, their scale is the wheel radius.
_WHEEL_SPEEDS = ("speed_left_m_s", "speed_right_m_s", "speed_x_m_s")
_WHEEL_RADIUS = "wheel_radius_m"
#: Channels of the force in the equation of motion, and units of channels it may be computed from.
FORCES = ("torque_left_N_m", "torque_right_N_m", "force_x_N")
_FORCE_UNITS = ("N", "N*m", "A", "Pa")
#: Units of speed in m/s, which must not be mistaken for a wheel radius: km/h, mile/h, knot, ft/s.
_SPEED_UNITS_M_S = (1.0 / 3.6, 0.44704, 0.514444, 0.3048)
_ANGLE = re.compile(r"(pitch|roll)\(\s*([^\s()]+)\s*\)")


class LogSection(BaseModel):
    """Where a table keeps its time, and how it is written. None: recognised, or asked for."""

    model_config = STRICT

    time: str | None = None
    time_unit: str | None = None
    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    header_row: int | None = Field(default=None, ge=0)
    units_row: int | None = Field(default=None, ge=0)
    day_first: bool | None = None
    rate_hz: float | None = Field(default=None, gt=0)
    sheet: str | None = None
    time_fraction: str | None = None
    sort_times: bool | None = None
    timezone: KnownTimeZone | None = None

    @model_serializer(mode="wrap")
    def _serialise_given_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Keep only the given keys, so that keys of later versions change no earlier file."""
        return {name: value for name, value in handler(self).items() if value is not None}


@cache
def _match_names(form: re.Pattern[str], derive: str | None) -> tuple[Any, ...] | None:
    """Names in a derivation of the given form; None if it has another one."""
    match = form.fullmatch((derive or "").strip())
    return match.groups() if match else None


class Channel(BaseModel):
    """Where one column comes from: a field of a topic, or other channels."""

    model_config = STRICT

    topic: str | None = None
    field: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    unit: str | None = None
    delay_s: float = 0.0
    valid_range: tuple[float, float] | None = None
    derive: str | None = None
    #: found in a log, not stated in the file
    _is_piecewise_constant: bool = PrivateAttr(default=False)

    @property
    def is_recorded_piecewise_constant(self) -> bool:
        """Whether the channel's readings in the log are constant between steps, like a gear."""
        return self._is_piecewise_constant

    def copy_as_piecewise_constant(self) -> Self:
        """Copy of the channel, marked as constant between steps."""
        channel = self.model_copy()
        channel._is_piecewise_constant = True  # noqa: SLF001  a copy of its own class
        return channel

    @property
    def differentiated_channel(self) -> str | None:
        """The channel that `derive = "d/dt NAME"` differentiates."""
        names = _match_names(_DERIVATIVE, self.derive)
        return names[0] if names else None

    @property
    def averaged_channels(self) -> tuple[str, str] | None:
        """The two channels that `derive = "mean(A, B)"` averages."""
        return _match_names(_MEAN, self.derive)

    @property
    def angle_and_quaternion_field(self) -> tuple[str, str] | None:
        """Angle and quaternion field of `derive = "pitch(FIELD)"` or `"roll(FIELD)"`; else None."""
        return _match_names(_ANGLE, self.derive)

    @property
    def expression(self) -> Expression | None:
        """Arithmetic such as `derive = "torque_N_m / 0.35 [m]"`, parsed; None for another form."""
        if (
            self.derive is None
            or self.differentiated_channel
            or self.averaged_channels
            or self.angle_and_quaternion_field
        ):
            return None
        return parse_expression(self.derive.strip())

    @property
    def is_derivative(self) -> bool:
        """Whether the channel is, or contains, a derivative of another channel."""
        tree = self.expression
        contains = tree is not None and any(iter_differentiated_channels(tree))
        return contains or self.differentiated_channel is not None

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields read from the channel's topic; empty if it is derived from other channels."""
        if self.angle_and_quaternion_field:
            return tuple(f"{self.angle_and_quaternion_field[1]}.{part}" for part in "xyzw")
        return () if self.field is None else (self.field,)

    @property
    def direct_source_channels(self) -> tuple[str, ...]:
        """Channels that this one is directly computed from; empty if it is recorded."""
        if (tree := self.expression) is not None:
            names = (name for name in iter_channel_names(tree) if name not in BODY_NUMBERS)
            return tuple(dict.fromkeys(names))
        rated = self.differentiated_channel
        return self.averaged_channels or ((rated,) if rated else ())

    @model_validator(mode="after")
    def _require_field_or_derivation(self) -> Self:
        if (self.field is None) == (self.derive is None):
            raise ValueError("give either 'field' (with 'topic') or 'derive'")
        if self.angle_and_quaternion_field:
            if self.unit is not None or self.scale != 1.0 or self.offset:
                raise ValueError(
                    "an angle of a quaternion takes no 'unit', 'scale' or 'offset'; remove it"
                )
            return self
        try:
            sources = self.direct_source_channels
        except ExpressionError as error:
            raise ValueError(f"cannot derive '{self.derive}': {error}") from None
        if self.derive is not None and not sources:
            raise ValueError(
                f'cannot derive \'{self.derive}\'; use "d/dt NAME", "mean(NAME, NAME)", '
                'arithmetic as "torque_N_m / 0.35 [m]", '
                'or "pitch(FIELD)" and "roll(FIELD)" of a quaternion'
            )
        if self.derive is not None and (self.topic is not None or self.unit is not None):
            raise ValueError("a derived channel takes no 'topic' and no 'unit'; remove it")
        if self.derive is not None and self.valid_range is not None:
            raise ValueError(
                "a derived channel takes no 'valid_range'; set valid_range of its source channels"
            )
        if self.valid_range is not None and not self.valid_range[0] < self.valid_range[1]:
            raise ValueError("valid_range = [lowest, highest] needs two numbers in this order")
        if self.derive is not None and self.delay_s:
            raise ValueError(
                "a derived channel takes no 'delay_s'; set delay_s of its source channels"
            )
        return self


class Machine(BaseModel):
    """A whole machine file."""

    model_config = STRICT

    machine: Body
    log: LogSection = LogSection()
    channels: dict[str, Channel] = {}
    settings: Settings = Settings.model_validate({})

    @model_validator(mode="before")
    @classmethod
    def _resolve_wheel_scale(cls, content: Any) -> Any:
        """Replace `scale = "wheel_radius_m"` by the machine's wheel radius, in m/rad."""
        if not isinstance(content, Mapping) or not isinstance(content.get("channels"), Mapping):
            return content
        body = content.get("machine")
        if not isinstance(body, Mapping):
            return content  # the error about the missing table is clearer than one about its key
        radius_m = body.get(_WHEEL_RADIUS)
        misspelt = {*content} - {*cls.model_fields} | {*body} - {*Body.model_fields}
        if radius_m is None and misspelt:
            return content  # likewise
        channels = dict(content["channels"])
        for name, channel in channels.items():
            if isinstance(channel, Mapping) and channel.get("scale") == _WHEEL_RADIUS:
                if radius_m is None:
                    raise ValueError(
                        f'channels.{name}: scale = "wheel_radius_m" needs machine.wheel_radius_m'
                    )
                channels[name] = {**channel, "scale": radius_m}
        return {**content, "channels": channels}

    @model_validator(mode="after")
    def _refuse_inconsistent_channels(self) -> Self:
        known = {column.name for column in CHANNEL_COLUMNS}
        for name, channel in self.channels.items():
            for source in channel.direct_source_channels:
                if source not in self.channels and channel.expression is not None:
                    raise ValueError(
                        f"channels.{name}: '{source}' is neither a channel nor a key of [machine]; "
                        f"{suggest_choice(source, (*self.channels, *BODY_NUMBERS))}"
                    )
        # channels that only arithmetic uses have names of their own, such as current_A
        known |= {
            source
            for channel in self.channels.values()
            if channel.expression is not None
            for source in channel.direct_source_channels
        }
        for name, channel in self.channels.items():
            if name not in known:
                raise ValueError(
                    f"channels.{name}: there is no channel of this name; "
                    f"{suggest_choice(name, known)}"
                )
            angle = channel.angle_and_quaternion_field
            if angle and name != f"{angle[0]}_rad":
                what = f"'{channel.derive}' computes {angle[0]}_rad; rename the channel to that"
                raise ValueError(f"channels.{name}: {what}")
            for source in channel.direct_source_channels:
                if source not in self.channels:
                    raise ValueError(f"channels.{name}: '{source}' is not a channel; add it")
            tree = channel.expression
            for key in iter_channel_names(tree) if tree is not None else ():
                if key in BODY_NUMBERS and getattr(self.machine, key) is None:
                    raise ValueError(f"channels.{name}: needs machine.{key}; give it")
        self.order_channels_by_derivation()
        self._require_force_speed_and_acceleration()
        self._refuse_different_wheel_radii()
        return self

    def _refuse_different_wheel_radii(self) -> None:
        """Raise an error if force and speed of the wheels use different radii."""
        for name in self.channels:
            ratio = self._compute_scale_over_wheel_radius(name)
            if ratio is not None and abs(ratio - 1.0) > LIMITS.wheel_difference_1:
                raise ValueError(
                    f"channels.{name}.scale is {abs(self.channels[name].scale):g} m/rad and "
                    f"machine.wheel_radius_m is {self.machine.wheel_radius_m:g}: two radii for one "
                    'wheel; correct one of them, or set scale = "wheel_radius_m", or unit = "m/s" '
                    "for a speed in m/s"
                )

    def _compute_scale_over_wheel_radius(self, channel_name: str) -> float | None:
        """Scale of a wheel speed over the wheel radius; None if it is not in m/rad."""
        radius_m, channel = self.machine.wheel_radius_m, self.channels[channel_name]
        if radius_m is None or channel_name not in _WHEEL_SPEEDS:
            return None
        scale = abs(channel.scale)
        if channel.unit is not None or channel.scale == 1.0:
            return None
        if any(abs(scale / unit - 1.0) < LIMITS.same_unit_1 for unit in _SPEED_UNITS_M_S):
            return None
        ratio = scale / radius_m
        is_radius = LIMITS.same_wheel_ratio <= ratio <= 1.0 / LIMITS.same_wheel_ratio
        return ratio if is_radius else None

    def depends_on_wheel_radius(self, channel_name: str) -> bool:
        """Whether a channel is computed with the wheel radius: by its scale or in arithmetic."""
        channel = self.channels.get(channel_name)
        return channel is not None and (
            (
                channel.expression is not None
                and _WHEEL_RADIUS in iter_channel_names(channel.expression)
            )
            or self._compute_scale_over_wheel_radius(channel_name) is not None
            or any(map(self.depends_on_wheel_radius, channel.direct_source_channels))
        )

    def _require_force_speed_and_acceleration(self) -> None:
        """Raise an error unless the channels give force, speed and acceleration."""
        torques = {"torque_left_N_m", "torque_right_N_m"} <= set(self.channels)
        if "force_x_N" not in self.channels and not torques:
            raise ValueError(
                "no force channel: give channels.force_x_N, or channels.torque_left_N_m and "
                "channels.torque_right_N_m"
            )
        if "force_x_N" not in self.channels and self.machine.wheel_radius_m is None:
            raise ValueError(
                "wheel torques need machine.wheel_radius_m to become a force "
                "(equation 17 of the paper)"
            )
        if "speed_x_m_s" not in self.channels:
            raise ValueError(
                "no speed channel: give channels.speed_x_m_s, or derive it, for example "
                'derive = "d/dt position_x_m" or "mean(speed_left_m_s, speed_right_m_s)"'
            )
        chosen = self.settings.forces.acceleration
        wanted = {"specific_force": "specific_force_x_m_s2", "kinematic": "acc_x_m_s2"}[chosen]
        if wanted not in self.channels:
            other = "kinematic" if chosen == "specific_force" else "specific_force"
            raise ValueError(
                f"settings.forces.acceleration is '{chosen}', which needs channels.{wanted}; give "
                f'that channel, or set settings.forces.acceleration = "{other}"'
            )

    @property
    def differentiates_speed(self) -> bool:
        """Whether the acceleration that multiplies the mass is the derivative of the speed."""
        channel = self.channels.get("acc_x_m_s2")
        kinematic = self.settings.forces.acceleration == "kinematic"
        return kinematic and channel is not None and channel.differentiated_channel == "speed_x_m_s"

    @property
    def differentiates_wheel_speed(self) -> bool:
        """Whether the acceleration is the derivative of a wheel speed, and wheels may slip."""
        return (
            self.differentiates_speed
            and self.channels["speed_x_m_s"].differentiated_channel is None
        )

    @property
    def recorded_force_channels(self) -> tuple[str, ...]:
        """Recorded channels that the force is computed from: forces, torques, currents, pressures.

        A speed or a gear in the arithmetic of the force does not count.
        """
        found: list[str] = []
        waiting = [name for name in FORCES if name in self.channels]
        for name in waiting:
            channel = self.channels[name]
            waiting += [each for each in channel.direct_source_channels if each not in waiting]
            if channel.fields and (name in FORCES or self._measures_force(name)):
                found.append(name)
        return tuple(found)

    @staticmethod
    def _measures_force(channel_name: str) -> bool:
        """Whether a channel used in arithmetic is in a unit of force, or a torque in percent."""
        unit = split_unit_from_name(channel_name)[1]
        if unit is None:
            return False
        registry = get_unit_registry()
        if registry.is_compatible_with(unit, "percent"):
            return "torque" in channel_name.lower()
        return any(registry.is_compatible_with(unit, each) for each in _FORCE_UNITS)

    def is_piecewise_constant(self, channel_name: str) -> bool:
        """Whether a channel is constant between steps, as recorded or by all of its sources."""
        channel = self.channels.get(channel_name)
        if channel is None:
            return False
        if channel.expression is None or not channel.direct_source_channels:
            return channel.is_recorded_piecewise_constant
        return all(map(self.is_piecewise_constant, channel.direct_source_channels))

    def order_channels_by_derivation(self) -> list[str]:
        """Channel names with sources first.

        Raises:
            ValueError: channels are derived from each other in a circle.
        """
        order: list[str] = []
        waiting = dict(self.channels)
        while waiting:
            ready = [
                n
                for n, c in waiting.items()
                if not any(s in waiting for s in c.direct_source_channels)
            ]
            if not ready:
                raise ValueError(
                    "these channels cannot be computed, since some are derived from each other "
                    f"in a circle: {', '.join(waiting)}; give one of them a field"
                )
            for name in ready:
                order.append(name)
                del waiting[name]
        return order
