"""Profile every field of a log: unit, rate, range, and a sparkline."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.errors import LogError
from replay.logs import Log
from replay.recognise.columns import find_list_elements
from replay.recognise.joints import list_joint_fields_with_values
from replay.recognise.recognise_limits import LIMITS

_BARS: Final = "▁▂▃▄▅▆▇█"
#: Fields of headers, which are not readings.
_NO_READINGS: Final = ("header.stamp", "header.seq", "header.frame_id")
_EFFORT_UNIT: Final = (
    "is effort a torque in N·m, or a motor current in A? if it is a current, set scale to the "
    "torque at the wheel per ampere"
)


@dataclass(frozen=True, slots=True, eq=False)
class FieldProfile:
    """Profile of a field of a topic.

    Attributes:
        topic: topic of the field.
        field: its name.
        unit: unit stated by the log, in pint's notation; None if it states none.
        rate_hz: rate of the readings; None below two readings.
        count: number of readings.
        low: smallest value; None if the field holds no numbers.
        middle: median.
        high: largest value.
        course: sparkline over the log.
    """

    topic: str
    field: str
    unit: str | None
    rate_hz: float | None
    count: int
    low: float | None
    middle: float | None
    high: float | None
    course: str

    def to_dict(self) -> dict[str, Any]:
        """Fields as plain JSON values, without the sparkline."""
        return {
            "topic": self.topic,
            "field": self.field,
            "unit": self.unit,
            "rate_hz": self.rate_hz,
            "count": self.count,
            "min": self.low,
            "median": self.middle,
            "max": self.high,
        }


def profile_fields(log: Log, topics: Sequence[str] | None = None) -> list[FieldProfile]:
    """Profile all fields with single values, in the log's order.

    Args:
        log: an opened log.
        topics: topics to profile; None for all readable ones.
    """
    found: list[FieldProfile] = []
    for row in log.topics().iter_rows(named=True):
        if row["problem"] or not row["messages"] or (topics and row["topic"] not in topics):
            continue
        names: list[str] = [f for f in row["fields"] or [] if f not in _NO_READINGS]
        fields = [name for name in names if "[]" not in name]
        if row["type"].rpartition("/")[2] == "JointState":
            fields += list_joint_fields_with_values(log, row["topic"], row["start_ns"])
        else:
            elements = find_list_elements(log, row)
            fields += [each for element in elements.values() for each in element]
        units = log.units(row["topic"])
        at_once = max(LIMITS.values_per_pass // row["messages"], LIMITS.fields_per_pass)
        for start in range(0, len(fields), at_once):
            part = fields[start : start + at_once]
            try:
                frame = log.read(row["topic"], part)
            except LogError:
                continue
            t = frame["log_time_ns"].to_numpy()
            # profiled together, since a numpy call per column is slow for thousands of them
            whole = [n for n in part if frame[n].dtype.is_float() or frame[n].dtype.is_integer()]
            x = frame.select(pl.col(whole).cast(pl.Float64)).to_numpy(order="fortran")
            known = np.isfinite(x).all(axis=0) if x.size else np.zeros(len(whole), dtype=bool)
            shapes = dict(
                zip(np.array(whole)[known], profile_columns_without_gaps(x[:, known]), strict=True)
            )
            for name in part:
                of = row["topic"], name, units.get(name), _compute_rate_hz(t, frame[name].count())
                shape = shapes.get(name)
                found.append(
                    profile_column_with_gaps(*of, frame[name])
                    if shape is None
                    else FieldProfile(*of, t.size, *shape)
                )
    return found


def _compute_rate_hz(t_ns: NDArray[np.int64], count: int) -> float | None:
    span_s = (int(t_ns[-1]) - int(t_ns[0])) / 1e9 if t_ns.size else 0.0
    return (count - 1) / span_s if count > 1 and span_s > 0 else None


class ColumnProfile(NamedTuple):
    """Smallest, median and largest value of a column, and its sparkline."""

    minimum: float
    median: float
    maximum: float
    sparkline: str


def profile_columns_without_gaps(values: Floats) -> list[ColumnProfile]:
    """Profile columns of finite values (rows, columns)."""
    if not values.size:
        return []
    low, high, middle = values.min(axis=0), values.max(axis=0), np.median(values, axis=0)
    parts = np.array_split(values, min(LIMITS.sparkline_characters, values.shape[0]))
    with np.errstate(all="ignore"):
        width = high - low
        shares = np.stack([part.mean(axis=0) for part in parts]) - low
        shares = np.where((width > 0) & np.isfinite(width), shares / width, 0.0)
        bars = np.nan_to_num(shares * len(_BARS)).clip(0, len(_BARS) - 1).astype(int)
    courses = ["".join(column) for column in np.array(list(_BARS))[bars].T.tolist()]
    columns = zip(low.tolist(), middle.tolist(), high.tolist(), courses, strict=True)
    return [ColumnProfile(*column) for column in columns]


def profile_column_with_gaps(
    topic: str, field: str, unit: str | None, rate_hz: float | None, cells: pl.Series
) -> FieldProfile:
    """Profile a column that has gaps or is not numeric."""
    numeric = cells.dtype.is_numeric() or cells.dtype == pl.Boolean
    present = cells.count()
    if not numeric:
        return FieldProfile(topic, field, unit, rate_hz, present, None, None, None, "text")
    x = cells.cast(pl.Float64).to_numpy()
    known = x[np.isfinite(x)]
    if not known.size:
        return FieldProfile(topic, field, unit, rate_hz, 0, None, None, None, "")
    low, high = float(known.min()), float(known.max())
    return FieldProfile(
        topic,
        field,
        unit,
        rate_hz,
        int(known.size),
        low,
        float(np.median(known)),
        high,
        draw_sparkline_text(x, low, high),
    )


def draw_sparkline_text(bin_means: Floats, low: float, high: float) -> str:
    """Draw a sparkline: the mean of each sixteenth of the log as a bar between `low` and `high`."""
    drawn = ""
    for part in np.array_split(bin_means, min(LIMITS.sparkline_characters, bin_means.size)):
        known = part[np.isfinite(part)]
        if not known.size:
            drawn += " "
            continue
        width = high - low
        share = (float(known.mean()) - low) / width if width > 0 and math.isfinite(width) else 0.0
        drawn += _BARS[min(int(share * len(_BARS)), len(_BARS) - 1)]
    return drawn


def ask_about_joint_efforts(
    used_fields: Collection[tuple[str, str]], field_profiles: Sequence[FieldProfile]
) -> list[str]:
    """Ask about units of joint efforts used as torques, and note efforts without a sign.

    Args:
        used_fields: topic and field of each channel.
        field_profiles: profiles of the log's fields.
    """
    efforts = {each for each in used_fields if each[1].startswith("effort[")}
    if not efforts:
        return []
    unsigned = [
        f"{each.field} lies between {each.low:.4g} and {each.high:.4g}, never below zero: a torque "
        "that brakes would be negative"
        for each in field_profiles
        if (each.topic, each.field) in efforts and each.low is not None and each.low >= 0.0
    ]
    return ["; ".join([_EFFORT_UNIT, *unsigned])]


def ask_about_twist_frame(
    used_fields: Collection[tuple[str, str]], field_profiles: Sequence[FieldProfile]
) -> list[str]:
    """Ask for the frame of a twist whose y component is no drift of a machine that drives along x.

    Args:
        used_fields: topic and field of each channel.
        field_profiles: profiles of the log's fields.
    """
    largest = {
        (each.topic, each.field): max(abs(each.low), abs(each.high))
        for each in field_profiles
        if each.low is not None and each.high is not None
    }
    questions: list[str] = []
    for topic, field in used_fields:
        across = (topic, f"{field.removesuffix('.x')}.y")
        if not field.endswith("linear.x") or across not in largest:
            continue
        if largest[across] > LIMITS.twist_across_fraction * largest.get((topic, field), 0.0):
            questions.append(
                f"is the twist of {topic} in the frame of the machine? {across[1]} reaches "
                f"{largest[across]:.3g} m/s, as in the frame of the map, where the x component is "
                "only a part of the speed"
            )
    return questions
