"""Channels that a table's columns fill, each with its reason, and what has to be asked.

A column is proposed where its name says which quantity it is and its unit fits; how it goes with
the others is said beside it. What the answer needs and no column tells is a question: the gear,
the radius, the side, the sign.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.physical_units import to_si
from analysis.model.schema import CHANNEL_COLUMNS
from analysis.stages.signals.derive import unit_of
from estimators.errors import LogError, MachineError
from replay.logs import Log
from replay.recognise.words import Meaning, meaning

Floats = NDArray[np.float64]

_KNOWN: Final = frozenset(column.name for column in CHANNEL_COLUMNS)
#: Rows that correlations are taken over, at most, and the span of a slope, in s.
_ROWS: Final = 200_000
_SPAN_S: Final = 0.2
#: A correlation that says something.
_CLEAR: Final = 0.5
#: Gravity on an axis, in m/s².
_GRAVITY: Final = (9.0, 10.6)
_GEAR: Final = "the gear ratio between motor and wheel, in channels.{}.derive"
_SIGN: Final = (
    "which way {} is positive: it goes against the change of speed ({:.2f}); if it is inverted, "
    "scale = -1"
)


@dataclass(frozen=True, slots=True)
class ChannelProposal:
    """A channel of a draft.

    Attributes:
        column: that is filled.
        topic: None for the table's own.
        field: that fills it; None where it is derived.
        unit: that the field is in; None for SI.
        reason: what it rests on.
        derive: the arithmetic, where it is derived.
        is_comment: whether something is missing, so that it stands there as a comment.
    """

    column: str
    topic: str | None
    field: str | None
    unit: str | None
    reason: str
    derive: str | None = None
    is_comment: bool = False


@dataclass(slots=True)
class Recognised:
    """Channels, and questions in the order of need."""

    channels: list[ChannelProposal] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Column:
    topic: str | None
    field: str
    unit: str | None
    said: Meaning
    bare: str


def recognise(log: Log) -> Recognised:
    """Recognise the channels of a table.

    Args:
        log: an opened table.
    """
    columns = _columns(log)
    found = Recognised()
    taken: set[str] = set()

    def take(column: _Column, name: str, reason: str, unit: str | None = None) -> None:
        if name in taken:
            return
        taken.add(name)
        unit = unit if unit is not None else column.unit
        found.channels.append(
            ChannelProposal(name, column.topic, column.field, _not_si(unit, name), reason)
        )

    for column in columns:
        if column.field in _KNOWN:
            take(column, column.field, "its name", unit=unit_of(column.field))
    for quantity, fill in _FILL.items():
        for column in columns:
            name = fill(column)
            if column.said.quantity == quantity and name is not None:
                stated = f"its name, in {column.unit}" if column.unit else "its name"
                take(column, name, stated)
    _motors(columns, found, taken)
    _without_unit(columns, found, taken)
    return _with_slopes(log, found)


def _columns(log: Log) -> list[_Column]:
    found: list[_Column] = []
    for row in log.topics().iter_rows(named=True):
        units = log.units(row["topic"])
        topic = None if row["topic"] == "table" else row["topic"]
        for name in row["fields"]:
            bare = _bare(name)
            found.append(_Column(topic, name, units.get(name), meaning(bare), bare))
    return found


def _bare(name: str) -> str:
    from analysis.model.physical_units import unit_behind

    cut = name
    for opening in "[(":
        cut = cut.partition(opening)[0] or cut
    return unit_behind(cut)[0]


def _fits(column: _Column, name: str) -> bool:
    """Whether a column's unit is of a channel's dimension; none fits for now."""
    if column.unit is None:
        return False
    try:
        to_si(column.unit, unit_of(name))
    except MachineError:
        return False
    return True


def _speed(column: _Column) -> str | None:
    if column.said.axis in ("y", "z") or column.said.part == "motor":
        return None
    name = f"speed_{column.said.side}_m_s" if column.said.side else "speed_x_m_s"
    return name if _fits(column, name) else None


def _force(column: _Column) -> str | None:
    if column.said.axis in ("y", "z") or column.said.side:
        return None
    return "force_x_N" if _fits(column, "force_x_N") else None


def _torque(column: _Column) -> str | None:
    side = column.said.side
    name = f"torque_{side}_N_m"
    return name if side and column.said.part != "motor" and _fits(column, name) else None


def _acceleration(column: _Column) -> str | None:
    axis = column.said.axis
    name = f"specific_force_{axis}_m_s2" if axis else None
    return name if name and _fits(column, name) else None


def _position(column: _Column) -> str | None:
    return (
        "position_x_m"
        if column.said.axis in (None, "x") and _fits(column, "position_x_m")
        else None
    )


def _yaw_rate(column: _Column) -> str | None:
    return "yaw_rate_rad_s" if _fits(column, "yaw_rate_rad_s") else None


def _angle(name: str, column: _Column) -> str | None:
    return name if _fits(column, name) and column.unit in ("deg", "rad") else None


_FILL: Final[dict[str, Callable[[_Column], str | None]]] = {
    "speed": _speed,
    "force": _force,
    "torque": _torque,
    "acceleration": _acceleration,
    "position": _position,
    "yaw rate": _yaw_rate,
    "boom": lambda column: _angle("boom_rad", column),
    "bucket": lambda column: _angle("bucket_rad", column),
    "latitude": lambda column: "latitude_deg" if _degrees(column) else None,
    "longitude": lambda column: "longitude_deg" if _degrees(column) else None,
}


def _degrees(column: _Column) -> bool:
    return column.unit in (None, "deg")


def _not_si(unit: str | None, name: str) -> str | None:
    """The unit that a channel has to name: none for SI."""
    if unit is None:
        return None
    gain, offset = to_si(unit, unit_of(name))
    return None if (gain, offset) == (1.0, 0.0) else unit


def _motors(columns: Sequence[_Column], found: Recognised, taken: set[str]) -> None:
    """A motor's torque, current and revolutions are force and speed by a gear that is asked for."""
    has_force = "force_x_N" in taken or {"torque_left_N_m", "torque_right_N_m"} <= taken
    source = next(
        (
            (column, name, factor)
            for quantity, unit, name, factor in (
                ("torque", "N*m", "motor_torque_N_m", ""),
                ("current", "A", "motor_current_A", " * TORQUE_CONSTANT [N*m/A]"),
            )
            for column in columns
            if column.said.quantity == quantity
            and (column.unit == unit or quantity == "current")
            and column.said.side is None
        ),
        None,
    )
    if not has_force and source is not None:
        column, name, factor = source
        reason = f"{column.field}: at the motor; needs the gear"
        found.channels.append(
            ChannelProposal(name, column.topic, column.field, column.unit, reason, is_comment=True)
        )
        derive = f"{name}{factor} * GEAR / wheel_radius_m"
        found.channels.append(
            ChannelProposal("force_x_N", None, None, None, reason, derive, is_comment=True)
        )
        found.questions.append(_GEAR.format("force_x_N"))
        if factor:
            found.questions.append("the motor's torque constant in N*m/A, in the same line")
        found.questions.append("machine.wheel_radius_m")
    if "speed_x_m_s" in taken or {"speed_left_m_s", "speed_right_m_s"} <= taken:
        return
    turns = next((c for c in columns if c.said.quantity == "erpm"), None) or next(
        (c for c in columns if c.said.quantity == "speed" and c.unit == "rpm"), None
    )
    if turns is None:
        return
    pairs = " / POLE_PAIRS" if turns.said.quantity == "erpm" else ""
    reason = f"{turns.field}: revolutions; needs the gear" + (" and pole pairs" if pairs else "")
    found.channels.append(
        ChannelProposal("motor_rpm", turns.topic, turns.field, None, reason, is_comment=True)
    )
    derive = f"motor_rpm{pairs} / GEAR * wheel_radius_m"
    found.channels.append(
        ChannelProposal("speed_x_m_s", None, None, None, reason, derive, is_comment=True)
    )
    found.questions.append(_GEAR.format("speed_x_m_s"))
    if pairs:
        found.questions.append("the motor's pole pairs, in the same line")
    found.questions.append("machine.wheel_radius_m")


def _without_unit(columns: Sequence[_Column], found: Recognised, taken: set[str]) -> None:
    """A column whose name says what it is, and nothing its unit."""
    given = taken | {each.column for each in found.channels}
    for quantity, name in _BY_UNIT.items():
        column = next(
            (
                c
                for c in columns
                if c.said.quantity == quantity
                and c.unit is None
                and c.said.side is None
                and c.said.part is None
                and c.said.axis in (None, "x")
            ),
            None,
        )
        if column is None or name in given:
            continue
        reason = f"{column.field}: its unit is not stated"
        found.channels.append(
            ChannelProposal(name, column.topic, column.field, "?", reason, is_comment=True)
        )
        found.questions.append(f"the unit of '{column.field}', in channels.{name}.unit")


#: Channels of quantities that one column holds for the whole machine.
_BY_UNIT: Final = {
    "force": "force_x_N",
    "speed": "speed_x_m_s",
    "acceleration": "specific_force_x_m_s2",
}


def _with_slopes(log: Log, found: Recognised) -> Recognised:
    """Say how forces and accelerations go with the change of the speed."""
    by_name = {each.column: each for each in found.channels if each.field}
    speed = by_name.get("speed_x_m_s") or by_name.get("speed_left_m_s") or by_name.get("motor_rpm")
    if speed is None:
        return found
    channels: list[ChannelProposal] = []
    for each in found.channels:
        is_force = each.column.startswith(("force", "torque", "motor_torque", "motor_current"))
        is_acceleration = each.column.startswith(("specific_force_x", "acc_x"))
        goes = None
        if each.field and (is_force or is_acceleration):
            goes = _correlation(log, each, speed)
        if goes is None:
            channels.append(each)
            continue
        reason = f"{each.reason}; goes with the change of {speed.field}, {goes:.2f}"
        channels.append(
            ChannelProposal(
                each.column, each.topic, each.field, each.unit, reason, each.derive, each.is_comment
            )
        )
        if goes < -_CLEAR:
            found.questions.append(_SIGN.format(f"'{each.field}'", goes))
    found.channels = channels
    found.questions = list(dict.fromkeys(found.questions))
    return found


def _correlation(log: Log, one: ChannelProposal, speed: ChannelProposal) -> float | None:
    """Correlation of a column with the slope of the speed; None where there is none."""
    assert one.field is not None
    assert speed.field is not None
    try:
        t, x = _series(log, one.topic, one.field)
        at, v = _series(log, speed.topic, speed.field)
    except (LogError, pl.exceptions.PolarsError):
        return None
    if t.size < 100 or at.size < 100:
        return None
    half = _SPAN_S / 2
    slope = np.interp(t + half, at, v) - np.interp(t - half, at, v)
    if x.std() == 0 or slope.std() == 0:
        return None
    return float(np.corrcoef(x, slope)[0, 1])


def _series(log: Log, topic: str | None, name: str) -> tuple[Floats, Floats]:
    frame = log.read(topic or "table", [name]).head(_ROWS)
    x = frame[name].cast(pl.Float64).to_numpy()
    # a table may have no row with a time
    t = (frame["log_time_ns"] - frame["log_time_ns"].min()).to_numpy() / 1e9
    known = np.isfinite(x)
    return t[known], x[known]
