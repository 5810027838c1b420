"""Check proposed columns by their readings: gravity, correlation with slopes, and signs."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.model.physical_units import find_gain_and_offset_to_si
from estimators.arrays import Floats
from estimators.errors import LogError
from replay.logs import TABLE, Log
from replay.recognise.proposals import ChannelProposal, LogColumn, Recognition
from replay.recognise.recognise_limits import LIMITS

_AXES: Final = frozenset({"x", "y", "z"})
_SIGN: Final = (
    "which direction of {} is positive: it correlates negatively with the change of speed ({:.2f});"
    " if it is inverted, set scale = -1"
)

_APART: Final = (
    "whether '{0}' moves the machine and '{1}' is its speed: they are not correlated ({2:.2f})"
)
_UNITS_APART: Final = (
    "the units of the time, '{0}' and '{1}': the change of '{1}' is {2:.3g} times '{0}'; if the "
    "time is wrong, correct [log] time_unit or rate_hz"
)
_MIRRORED: Final = (
    "which direction of '{0}' and '{1}' is positive: they correlate negatively ({2:.2f}); if one "
    "is mounted mirrored, set scale = -1 for it and its torque"
)
_AGAINST_PLACE: Final = (
    "which direction of '{0}' is positive: it correlates negatively with the change of '{1}' "
    "({2:.2f}); if it is inverted, set scale = -1"
)
_WITHOUT_SIGN: Final = (
    "in which direction '{0}' acts: it is never negative, and no smaller while the machine brakes; "
    "another column may give its sign, as in where(braking_1 > 0.5, -x, x)"
)
_WRAPPED: Final = (
    "which numbers of '{0}' are negative: it jumps by 2^{1}; if those of the upper half are, "
    "use where(x > {2}, x - {3}, x)"
)
#: Channels of the speed of a side, in m/s or as revolutions, with {} for the side.
_OF_SIDES: Final = (
    *("speed_{}_m_s", "wheel_{}_rpm"),
    *("{}_motor_torque_N_m", "{}_torque_percent", "{}_motor_current_A"),
)


def find_accelerometer_axes(columns: Sequence[LogColumn]) -> list[LogColumn]:
    """Find the three axes of the only accelerometer; empty if there are several, or not three."""
    found = [
        c for c in columns if c.name_meaning.quantity == "acceleration" and c.name_meaning.axis
    ]
    axes = sorted(c.name_meaning.axis for c in found if c.name_meaning.axis)
    return found if axes == sorted(_AXES) else []


class Readings(NamedTuple):
    """Times of a column in s, and its readings at these times."""

    times_s: Floats
    readings: Floats


class ColumnReader:
    """Reader of a log's columns, which decodes each topic once, from its start."""

    def __init__(self, log: Log, columns: Sequence[LogColumn]) -> None:
        """Prepare to read columns of a log.

        Args:
            log: an opened log.
            columns: columns of the log; columns of known quantity are decoded together.
        """
        self._log = log
        self._named = {
            topic: [c.field for c in columns if c.topic == topic and c.name_meaning.quantity]
            for topic in {column.topic for column in columns}
        }
        self._first_ns = dict(log.topics().select("topic", "start_ns").iter_rows())
        self._frames: dict[tuple[str | None, tuple[str, ...]], pl.DataFrame] = {}

    def read_times_and_readings(self, topic: str | None, field: str) -> Readings:
        """Read a column: times in s from the first row, and finite readings.

        Raises:
            LogError: the column cannot be read.
        """
        frame = self._read_field_with_others_of_topic(topic, field)
        x = frame[field].cast(pl.Float64).to_numpy()
        t = (frame["log_time_ns"] - frame["log_time_ns"].min()).to_numpy() / 1e9
        known = np.isfinite(x)
        return Readings(t[known], x[known])

    def _read_field_with_others_of_topic(self, topic: str | None, field: str) -> pl.DataFrame:
        named = self._named.get(topic, [])
        if field in named:
            try:
                return self._read_fields(topic, tuple(named))
            except (LogError, pl.exceptions.PolarsError):
                # another column of the topic may be unreadable: read each by itself from now on
                self._named[topic] = []
        return self._read_fields(topic, (field,))

    def _read_fields(self, topic: str | None, fields: tuple[str, ...]) -> pl.DataFrame:
        if (topic, fields) not in self._frames:
            first_ns = self._first_ns[topic or TABLE]
            last_ns = None if first_ns is None else first_ns + LIMITS.correlation_span_ns
            frame = self._log.read(topic or TABLE, list(fields), end_ns=last_ns)
            self._frames[topic, fields] = frame.head(LIMITS.correlation_max_rows)
        return self._frames[topic, fields]


def guess_accelerometer_units(
    reader: ColumnReader, columns: Sequence[LogColumn]
) -> dict[LogColumn, tuple[str, str]]:
    """Guess the unit of an accelerometer that states none, if one axis shows gravity.

    Args:
        reader: reader of the log's columns.
        columns: columns of the table.
    """
    axes = [column for column in find_accelerometer_axes(columns) if column.unit is None]
    for column in axes if len(axes) == len(_AXES) else ():
        middle = abs(_compute_median_of_column(reader, column))
        for unit, (low, high) in (
            ("m/s**2", LIMITS.gravity_m_s2),
            ("standard_gravity", LIMITS.gravity_g),
        ):
            if low <= middle <= high:
                reason = f"gravity is on '{column.source_text}' ({middle:.2f}): in {unit}"
                return dict.fromkeys(axes, (unit, reason))
    return {}


def find_accelerations_without_gravity(
    reader: ColumnReader, columns: Sequence[LogColumn]
) -> set[LogColumn]:
    """Find the axes of an accelerometer whose gravity a program has removed; empty otherwise."""
    axes = [column for column in find_accelerometer_axes(columns) if column.unit is not None]
    if len(axes) != len(_AXES):
        return set()
    total = 0.0
    for column in axes:
        assert column.unit is not None
        if not column.has_dimension_of_channel("acc_x_m_s2"):
            return set()
        total += (
            _compute_median_of_column(reader, column)
            * find_gain_and_offset_to_si(column.unit, "m/s²")[0]
        ) ** 2
    return set(axes) if total < (LIMITS.gravity_m_s2[0] / 2) ** 2 else set()


def do_columns_hold_same_readings(
    reader: ColumnReader, column: LogColumn, other_column: LogColumn
) -> bool:
    """Whether two columns hold the same readings: their difference is small."""
    try:
        (t, x), (at, y) = (
            reader.read_times_and_readings(c.topic, c.field) for c in (column, other_column)
        )
    except (LogError, pl.exceptions.PolarsError):
        return False
    if (
        min(t.size, at.size) < LIMITS.correlation_min_rows
        or column.unit is None
        or other_column.unit is None
    ):
        return False
    y = y * find_gain_and_offset_to_si(other_column.unit, column.unit)[0]
    return float(np.std(x - np.interp(t, at, y))) < LIMITS.same_reading_fraction * float(np.std(x))


def _compute_median_of_column(reader: ColumnReader, column: LogColumn) -> float:
    try:
        _, x = reader.read_times_and_readings(column.topic, column.field)
    except (LogError, pl.exceptions.PolarsError):
        return 0.0
    return float(np.median(x)) if x.size else 0.0


def add_correlations_with_slope_as_remarks(
    reader: ColumnReader, columns: Sequence[LogColumn], recognition: Recognition
) -> Recognition:
    """Add remarks on correlations of forces and accelerations with the speed's slope.

    The correlation of speeds with the slope of the position is added as well.
    """
    by_name = {each.column: each for each in recognition.channels if each.field}
    speed = by_name.get("speed_x_m_s") or by_name.get("speed_left_m_s") or by_name.get("motor_rpm")
    place = by_name.get("position_x_m") or next(
        (
            ChannelProposal("position_x_m", c.topic, c.field, c.unit, "")
            for c in columns
            if c.name_meaning.quantity == "position" and c.has_dimension_of_unit("m")
        ),
        None,
    )
    add_question_if_side_turns_backwards(reader, by_name, recognition)
    channels: list[ChannelProposal] = []
    for each in recognition.channels:
        reason = each.reason
        add_question_if_integers_wrap_to_negative(reader, each, recognition)
        quantity = each.column.removeprefix("left_").removeprefix("right_")
        is_force = quantity.startswith(("force", "torque", "motor_torque", "motor_current"))
        is_acceleration = each.column.startswith(("specific_force_x", "acc_x"))
        if each.field and speed is not None and (is_force or is_acceleration):
            goes = correlate_column_with_slope(reader, each, speed)
            if goes is not None:
                reason += f"; correlates with the change of {speed.source_text}, {goes:.2f}"
                if goes < -LIMITS.clear_correlation:
                    recognition.add_question_of_subject(
                        "sign", _SIGN.format(f"'{each.source_text}'", goes)
                    )
                if is_force and abs(goes) < LIMITS.absent_correlation:
                    recognition.add_question_of_subject(
                        "column", _APART.format(each.source_text, speed.source_text, goes)
                    )
            if is_acceleration:
                add_question_if_units_contradict_derivative(reader, each, speed, recognition)
            if is_force:
                add_question_on_sign_of_nonnegative_force(reader, each, speed, recognition)
        if each is speed and place is not None:
            add_question_if_units_contradict_derivative(reader, each, place, recognition)
            goes = correlate_column_with_slope(reader, each, place)
            if goes is not None and goes < -LIMITS.clear_correlation:
                recognition.add_question_of_subject(
                    "sign", _AGAINST_PLACE.format(each.source_text, place.source_text, goes)
                )
            if goes is not None and abs(goes) > LIMITS.clear_correlation:
                reason += f"; correlates with the change of {place.source_text}, {goes:.2f}"
        channels.append(replace(each, reason=reason))
    recognition.channels = channels
    return recognition


def add_question_if_side_turns_backwards(
    reader: ColumnReader, proposals_by_channel: dict[str, ChannelProposal], recognition: Recognition
) -> None:
    """Ask which side turns backwards if the speeds of both sides have opposite signs.

    Motors are often mounted mirror-inverted; the mean of both sides would then be zero.
    """
    for name in _OF_SIDES:
        left, right = (proposals_by_channel.get(name.format(side)) for side in ("left", "right"))
        if left is None or right is None:
            continue
        (t, x), (at, y) = (
            read_times_and_readings_of_proposal(reader, left),
            read_times_and_readings_of_proposal(reader, right),
        )
        goes = (
            compute_correlation(x, np.interp(t, at, y))
            if min(t.size, at.size) >= LIMITS.correlation_min_rows
            else None
        )
        if goes is not None and goes < -LIMITS.clear_correlation:
            recognition.add_question_of_subject(
                "sign", _MIRRORED.format(left.source_text, right.source_text, goes)
            )


def add_question_if_units_contradict_derivative(
    reader: ColumnReader,
    rate_proposal: ChannelProposal,
    integral_proposal: ChannelProposal,
    recognition: Recognition,
) -> None:
    """Ask for the units of a column and its derivative if their magnitudes disagree."""
    if "?" in (rate_proposal.unit, integral_proposal.unit) or not (
        rate_proposal.column in _SI and integral_proposal.column in _SI
    ):
        return
    (t, x), (at, y) = (
        read_times_and_readings_of_proposal(reader, rate_proposal),
        read_times_and_readings_of_proposal(reader, integral_proposal),
    )
    if min(t.size, at.size) < LIMITS.correlation_min_rows:
        return
    gains = [
        find_gain_and_offset_to_si(each.unit, _SI[each.column])[0] if each.unit else 1.0
        for each in (rate_proposal, integral_proposal)
    ]
    x, change = x * gains[0], compute_slope_at_times(t, at, y * gains[1]) / LIMITS.slope_span_s
    goes = compute_correlation(x, change)
    if goes is None or goes < LIMITS.unit_min_correlation:
        return
    times = float(change.std() / x.std())
    if not LIMITS.unit_ratio_range[0] < times < LIMITS.unit_ratio_range[1]:
        recognition.add_question_of_subject(
            "unit",
            _UNITS_APART.format(rate_proposal.source_text, integral_proposal.source_text, times),
        )


#: Units of channels, of which some are derivatives of others.
_SI: Final = {
    "position_x_m": "m",
    "speed_x_m_s": "m/s",
    "acc_x_m_s2": "m/s²",
    "specific_force_x_m_s2": "m/s²",
}


def add_question_if_integers_wrap_to_negative(
    reader: ColumnReader, proposal: ChannelProposal, recognition: Recognition
) -> None:
    """Ask which values are negative if integers jump between the ends of their range."""
    x = read_times_and_readings_of_proposal(reader, proposal)[1]
    if x.size < LIMITS.correlation_min_rows or x.min() < 0 or (x != np.rint(x)).any():
        return
    largest, jump = float(x.max()), float(np.abs(np.diff(x)).max())
    for bits in LIMITS.wrapped_bits:
        half = 2 ** (bits - 1)
        if half < jump and half < largest < 2 * half:
            recognition.add_question_of_subject(
                "sign", _WRAPPED.format(proposal.source_text, bits, half - 1, 2 * half)
            )


def add_question_on_sign_of_nonnegative_force(
    reader: ColumnReader,
    force_proposal: ChannelProposal,
    speed_proposal: ChannelProposal,
    recognition: Recognition,
) -> None:
    """Ask for the sign of a force that is never negative although it is large during braking."""
    (t, x), (at, y) = (
        read_times_and_readings_of_proposal(reader, force_proposal),
        read_times_and_readings_of_proposal(reader, speed_proposal),
    )
    if (
        min(t.size, at.size) < LIMITS.correlation_min_rows
        or x.min() < -LIMITS.unsigned_noise_fraction * x.max()
    ):
        return
    slope = compute_slope_at_times(t, at, y)
    starts, stops = x[slope > slope.max() / 2], x[slope < slope.min() / 2]
    if (
        slope.min() < 0 < slope.max()
        and stops.mean() > LIMITS.unsigned_braking_fraction * starts.mean() > 0
    ):
        recognition.add_question_of_subject(
            "sign", _WITHOUT_SIGN.format(force_proposal.source_text)
        )


def read_times_and_readings_of_proposal(
    reader: ColumnReader, proposal: ChannelProposal
) -> Readings:
    """Read times in s and readings of a proposed channel; empty if they cannot be read."""
    if proposal.field is None:
        return Readings(np.empty(0), np.empty(0))
    try:
        return reader.read_times_and_readings(proposal.topic, proposal.field)
    except (LogError, pl.exceptions.PolarsError):
        return Readings(np.empty(0), np.empty(0))


def compute_slope_at_times(times_s: Floats, sample_times_s: Floats, samples: Floats) -> Floats:
    """Change of `samples`, taken at `sample_times_s`, over a short span about each of `times_s`."""
    half = LIMITS.slope_span_s / 2
    return np.interp(times_s + half, sample_times_s, samples) - np.interp(
        times_s - half, sample_times_s, samples
    )


def correlate_column_with_slope(
    reader: ColumnReader, proposal: ChannelProposal, sloped_column: ChannelProposal
) -> float | None:
    """Correlation of a column with the slope of another; None if undefined."""
    (t, x), (at, y) = (
        read_times_and_readings_of_proposal(reader, proposal),
        read_times_and_readings_of_proposal(reader, sloped_column),
    )
    return (
        compute_correlation(x, compute_slope_at_times(t, at, y))
        if min(t.size, at.size) >= LIMITS.correlation_min_rows
        else None
    )


def compute_correlation(first_series: Floats, second_series: Floats) -> float | None:
    """Compute the correlation of two series; None if one is constant or not finite."""
    # scaled to 1 first, since squares may exceed the range of a float64
    first_series, second_series = (
        each / (float(np.abs(each).max()) or 1.0) for each in (first_series, second_series)
    )
    if not (
        np.isfinite(second_series).all() and first_series.std() > 0 and second_series.std() > 0
    ):
        return None
    return float(np.corrcoef(first_series, second_series)[0, 1])
