"""Channels in SI units at their own rates: read, scaled, equally filtered, derived."""

from collections.abc import Mapping

import numpy as np
import polars as pl

from analysis.expressions.expression_limits import LIMITS as EXPRESSION_LIMITS
from analysis.expressions.parse import (
    SLOPE,
    Expression,
    ExpressionError,
    Name,
    convert_to_si,
    format_dimension,
    iter_channel_names,
    iter_differentiated_channels,
)
from analysis.expressions.values import evaluate_and_count_near_zero_divisors
from analysis.model import physical_units
from analysis.model.loss import Loss
from analysis.model.machine import Channel, Machine
from analysis.model.machine_body import BODY_NUMBERS
from analysis.model.schema import CHANNEL_COLUMNS, HINTS
from analysis.model.settings import AlignSettings
from analysis.stages.signals import filters, mounting
from analysis.stages.signals.piecewise_constant import interpolate_between_steps
from analysis.stages.signals.rates import ChannelSamples
from analysis.stages.signals.signal_limits import LIMITS
from estimators.errors import DataError, MachineError, NoReadingError

_SI = {column.name: column.unit for column in CHANNEL_COLUMNS}
#: Angles and places are not in the regressor, so they are not filtered with it.
UNFILTERED = frozenset({"pitch_rad", "roll_rad"}) | HINTS


def derive_channels_in_si(
    measured: Mapping[str, mounting.Series], machine: Machine
) -> tuple[dict[str, ChannelSamples], list[str]]:
    """Filter the measured channels, and derive the others of the machine file from them.

    If any channel is differentiated, the same zero-phase low-pass (causal if so set) is applied to
    every force and motion channel at its own rate, before derivatives: a filter on one regressor
    alone biases the mass. A rotated IMU's axes are turned to the machine's after the filter and
    before derivatives.

    Args:
        measured: channels from `read_measured_channels`.
        machine: machine file with channels and settings.

    Returns:
        Samples by channel, including `direction_x_1`; and notes.
    """
    settings = machine.settings
    notes: list[str] = []
    filtering = any(channel.is_derivative for channel in machine.channels.values())
    picked = low_pass_fast_channels(measured, machine, notes) if filtering else dict(measured)

    series = mounting.rotate_imu_to_machine_axes(picked, machine.machine.imu, settings.align)
    for name in machine.order_channels_by_derivation():
        channel = machine.channels[name]
        if channel.differentiated_channel:
            t, x = series[channel.differentiated_channel]
            longest_ns = filters.compute_gap_threshold_ns(t, settings.align)
            t, x = filters.differentiate_signal(t, x, longest_ns, causal=settings.filter.causal)
        elif channel.averaged_channels:
            first, second = channel.averaged_channels
            t, x = average_two_channels(series[first], series[second], settings.align)
        elif channel.expression is not None:
            t, x = compute_arithmetic_channel(name, series, machine, notes)
        else:
            continue
        series[name] = _zero_unresolved_samples(name, t, x * channel.scale + channel.offset)
    # of channels that only arithmetic needs, a causal grid uses the arrival times alone
    whole, series = series, {name: each for name, each in series.items() if name in _SI}
    t, speed = series["speed_x_m_s"]
    # at standstill the sign of the speed would be pure noise
    moves = np.abs(speed) > settings.forces.direction_deadband_m_s
    series["direction_x_1"] = t, np.where(moves, np.sign(speed), 0.0)
    causal = settings.filter.causal
    known = find_known_times_of_samples_ns(measured, picked, whole, machine) if causal else {}
    return {n: ChannelSamples(t, x, known.get(n)) for n, (t, x) in series.items()}, notes


def parse_derivation_in_si(name: str, machine: Machine) -> Expression:
    """Expression that derives a channel, in SI units.

    Raises:
        MachineError: the units do not match; the message names both sides.
    """
    tree = machine.channels[name].expression
    assert tree is not None
    try:
        units = {each: find_unit_in_name(each) for each in iter_channel_names(tree)}
        registry = physical_units.get_unit_registry()
        found, dimension = convert_to_si(tree, units, registry)
        _, wanted = convert_to_si(Name(name), {name: find_unit_in_name(name)}, registry)
    except (ExpressionError, MachineError) as error:
        raise MachineError(f"channels.{name}: {error}") from None
    if dimension != wanted:
        raise MachineError(
            f"channels.{name} is {format_dimension(wanted)}, '{machine.channels[name].derive}' is "
            f"{format_dimension(dimension)}: multiply or divide by a constant with its unit in "
            "brackets, as 0.35 [m]"
        )
    return found


def find_unit_in_name(name: str) -> str:
    """Unit at the end of a channel's or machine key's name.

    Raises:
        MachineError: the name does not end in a unit.
    """
    if name in _SI:
        return "" if _SI[name] == "1" else _SI[name]
    _, unit = physical_units.split_unit_from_name(name)
    if unit is None and name not in BODY_NUMBERS and not name.endswith("_1"):
        raise MachineError(
            f"'{name}' lacks its unit at the end: {name}_N_m, {name}_A; {name}_1 if dimensionless"
        )
    return unit or ""


def compute_arithmetic_channel(
    name: str, series: Mapping[str, mounting.Series], machine: Machine, notes: list[str]
) -> mounting.Series:
    """Compute a channel from others at the stamps of the slowest, with interpolation.

    A gear does not count as the slowest channel: it is constant between equal readings. Samples
    without a value, as where a divisor is near zero or a gear changes, are left out.
    """
    tree, settings = parse_derivation_in_si(name, machine), machine.settings
    own = {each: series[each] for each in iter_channel_names(tree) if each not in BODY_NUMBERS}
    for each in iter_differentiated_channels(tree):
        t, x = series[each]
        longest_ns = filters.compute_gap_threshold_ns(t, settings.align)
        own[f"{SLOPE} {each}"] = filters.differentiate_signal(
            t, x, longest_ns, causal=settings.filter.causal
        )
    steps = {each for each in own if machine.is_piecewise_constant(each)}
    at = max(
        (t for each, (t, _) in own.items() if each not in steps or len(steps) == len(own)),
        key=lambda t: (filters.compute_median_period_ns(t), -t.size),
    )
    values: dict[str, filters.Floats] = {}
    for each, (t, x) in own.items():
        read = interpolate_between_steps if each in steps else filters.interpolate_in_stretches
        longest_ns = filters.compute_gap_threshold_ns(t, settings.align)
        values[each] = x if np.array_equal(t, at) else read(t, x, at, longest_ns)
    for each in BODY_NUMBERS:
        number = getattr(machine.machine, each)
        values[each] = np.full(at.size, np.nan if number is None else number)
    x, near_zero = evaluate_and_count_near_zero_divisors(tree, values, at.size)
    if near_zero:
        notes.append(
            f"{name}: {near_zero:,} of {at.size:,} samples divide by nearly zero (below "
            f"{EXPRESSION_LIMITS.near_zero_fraction:.0%} of the divisor's range): they are excluded"
        )
    known = np.isfinite(x)
    return at[known], x[known]


def read_measured_channels(
    stamped_topics: Mapping[str, pl.DataFrame], machine: Machine
) -> tuple[dict[str, mounting.Series], list[Loss]]:
    """Read every measured channel: in SI units, finite, one sample per stamp.

    Args:
        stamped_topics: frames by topic with unix_ns and fields; optional topics may be missing.
        machine: machine file with channels.

    Returns:
        Stamps and samples by channel, before any filter; and losses of invalid readings.
    """
    losses: list[Loss] = []
    read: dict[str, mounting.Series] = {}
    for name, channel in machine.channels.items():
        topic = channel.topic or "table"
        if channel.direct_source_channels or (name in HINTS and topic not in stamped_topics):
            continue
        try:
            read[name] = (
                compute_angle_from_orientation(
                    name, channel, stamped_topics[topic], machine, losses
                )
                if channel.angle_and_quaternion_field
                else read_field_of_channel(name, channel, stamped_topics[topic], losses)
            )
        except NoReadingError as error:
            # a hint without readings counts as absent
            if name not in HINTS:
                raise
            losses.append(Loss(source=name, what=str(error).removeprefix(f"{name}: ")))
    return share_equal_stamp_arrays(read), losses


def share_equal_stamp_arrays(channels: Mapping[str, mounting.Series]) -> dict[str, mounting.Series]:
    """The same channels, with equal arrays of stamps replaced by one shared array."""
    out: dict[str, mounting.Series] = {}
    for name, (t, x) in channels.items():
        out[name] = next((each for each, _ in out.values() if np.array_equal(each, t)), t), x
    return out


def low_pass_fast_channels(
    measured: Mapping[str, mounting.Series], machine: Machine, notes: list[str]
) -> dict[str, mounting.Series]:
    """Apply the low-pass to every channel whose rate allows it.

    A causal filter delays, so if one channel's rate is too low, none is filtered.
    """
    settings = machine.settings
    cutoff_hz, causal = settings.filter.cutoff_hz, settings.filter.causal
    rates_hz = {
        n: 1e9 / filters.compute_median_period_ns(t)
        for n, (t, _) in measured.items()
        if n not in UNFILTERED and not machine.is_piecewise_constant(n)
    }
    most = LIMITS.cutoff_max_rate_fraction
    slow = {name: hz for name, hz in rates_hz.items() if cutoff_hz > most * hz}
    notes += [
        f"{name}: low-pass of {cutoff_hz:g} Hz not applied, its topic has only {hz:.4g} Hz"
        for name, hz in slow.items()
    ]
    if causal and slow:
        notes.append("nor to others: a causal filter on some channels would delay only those")
        return dict(measured)
    out = dict(measured)
    for name in (each for each in rates_hz if each not in slow):
        t, x = measured[name]
        longest_ns = filters.compute_gap_threshold_ns(t, settings.align)
        filtered = filters.apply_low_pass(t, x, cutoff_hz, longest_ns, causal=causal)
        out[name] = _zero_unresolved_samples(name, *filtered)
    return out


def compute_angle_from_orientation(
    name: str, channel: Channel, frame: pl.DataFrame, machine: Machine, losses: list[Loss]
) -> tuple[filters.Ints, filters.Floats]:
    """Stamps and angle of the machine in rad, (n,) each, from its IMU's orientation."""
    assert channel.angle_and_quaternion_field is not None
    angle, quaternion = channel.angle_and_quaternion_field
    parts = np.stack([_read_field_numbers(name, channel, field, frame) for field in channel.fields])
    x = mounting.compute_pitch_and_roll(parts, machine.machine.imu)[angle]
    return select_usable_readings(name, channel, quaternion, frame, x, losses)


def read_field_of_channel(
    name: str, channel: Channel, frame: pl.DataFrame, losses: list[Loss]
) -> tuple[filters.Ints, filters.Floats]:
    """Stamps and values of a channel's field in SI units, (n,) each."""
    field = str(channel.field)
    frame = filters.drop_readings_outside_range(name, channel, frame, losses)
    gain, offset = 1.0, 0.0
    if channel.unit:
        si_unit = find_unit_in_name(name)
        gain, offset = physical_units.find_gain_and_offset_to_si(channel.unit, si_unit)
    with np.errstate(over="ignore"):  # what does not fit is no reading
        x = _read_field_numbers(name, channel, field, frame) * channel.scale + channel.offset
        x = x * gain + offset
    return select_usable_readings(name, channel, field, frame, x, losses)


def _read_field_numbers(
    name: str, channel: Channel, field: str, frame: pl.DataFrame
) -> filters.Floats:
    readings = frame[field]
    dtype = readings.dtype
    if dtype == pl.Float64:
        return readings.to_numpy()
    if not (dtype.is_numeric() or dtype == pl.Boolean or dtype == pl.Null):
        where = f"{field} of {channel.topic or 'the table'}"
        raise DataError(f"{name}: {where} is {dtype}, not a number; choose another field")
    return readings.cast(pl.Float64).to_numpy()


def select_usable_readings(
    name: str,
    channel: Channel,
    field: str,
    frame: pl.DataFrame,
    readings: filters.Floats,
    losses: list[Loss],
) -> tuple[filters.Ints, filters.Floats]:
    """Times of measurement and valid readings, (n,) each; the last one of each stamp."""
    where = f"{field} of {channel.topic or 'the table'}"
    t = frame["unix_ns"].to_numpy()
    delay_ns = round(channel.delay_s * 1e9)
    if t.size > 1 and (np.abs(readings) <= LIMITS.largest_si).all() and (np.diff(t) > 0).all():
        # nothing to leave out: the usual case of a follower
        return t - delay_ns, set_values_below_resolution_to_zero(readings)
    finite = np.isfinite(readings)
    if not finite.any():
        raise NoReadingError(f"{name}: {where} has no number in {readings.size} samples")
    told = finite & (np.abs(readings) <= LIMITS.largest_si)
    limit = f"beyond {LIMITS.largest_si:g} {find_unit_in_name(name)}, which cannot be a reading"
    if not told.any():
        raise DataError(f"{name}: {where} has only numbers {limit}; check its unit and scale")
    # in messages, as opposed to a table, every missing reading was lost
    lost = int((~finite).sum()) if channel.topic else filters.count_lost_readings(t, finite)
    counts = ((lost, "missing or not finite"), (int((finite & ~told).sum()), limit))
    for count, why in counts:
        if count:
            losses.append(
                Loss(
                    source=name,
                    topic=channel.topic or "",
                    what=f"{count} of {finite.size} samples of {field} are {why}; they were "
                    "excluded",
                )
            )
    last = np.append(np.diff(t[told]) > 0, True)
    if not last.all():
        losses.append(
            Loss(
                source=name,
                topic=channel.topic or "",
                what=f"{int((~last).sum())} samples of {field} share a stamp with the "
                "next; the last of each was kept",
            )
        )
    t, readings = t[told][last], readings[told][last]
    if t.size < 2:
        raise DataError(f"{name}: {where} has a single sample, but at least two are needed")
    return t - delay_ns, set_values_below_resolution_to_zero(readings)


def _zero_unresolved_samples(name: str, t_ns: filters.Ints, x: filters.Floats) -> mounting.Series:
    """A processed channel with values below the resolution set to 0; a DataError if it is empty."""
    if t_ns.size == 0:
        raise DataError(
            f"{name}: every stretch between gaps of the log is too short to differentiate, "
            "combine or low-pass this channel; give a log with fewer gaps"
        )
    return t_ns, set_values_below_resolution_to_zero(x)


def set_values_below_resolution_to_zero(values: filters.Floats) -> filters.Floats:
    """Values (n,), 0 where below `smallest_si` in magnitude, as a decaying filter output is."""
    return np.where(np.abs(values) < LIMITS.smallest_si, 0.0, values)


def average_two_channels(
    a: mounting.Series, b: mounting.Series, settings: AlignSettings
) -> mounting.Series:
    """Mean of two channels at the stamps of one, with the other interpolated.

    The stamps are those of `b` if it is much slower, so that it is not interpolated, else of `a`.
    """
    if a[0] is b[0]:
        return a[0], (a[1] + b[1]) / 2.0
    period_ns = filters.compute_median_period_ns
    if period_ns(b[0]) > LIMITS.other_rate_ratio * period_ns(a[0]):
        a, b = b, a
    longest_ns = filters.compute_gap_threshold_ns(b[0], settings)
    t, other = filters.interpolate_linearly(*b, a[0], longest_ns)
    return t, (a[1][np.searchsorted(a[0], t)] + other) / 2.0


def find_known_times_of_samples_ns(
    channels: Mapping[str, mounting.Series],
    picked_channels: Mapping[str, mounting.Series],
    series: Mapping[str, mounting.Series],
    machine: Machine,
) -> dict[str, filters.Ints]:
    """Time at which each sample of each channel is known on board.

    Args:
        channels: channels as read.
        picked_channels: the same channels after the low-pass filter, if one is used.
        series: the same in machine axes, and the derived channels, each after its sources.
        machine: machine file with delays and derived channels.
    """
    filtered: dict[str, filters.Ints] = {}
    for name, (t, _) in channels.items():
        delay_ns = round(machine.channels[name].delay_s * 1e9)
        filtered[name] = filters.compute_interpolation_ready_ns(
            t, t + delay_ns if delay_ns else t, picked_channels[name][0]
        )
    known: dict[str, filters.Ints] = {}
    for name, own in filtered.items():
        beside = mounting.list_axes_rotated_together(name, picked_channels, machine.machine.imu)
        at = series[name][0]
        each = [
            filters.compute_interpolation_ready_ns(picked_channels[other][0], filtered[other], at)
            for other in beside
        ]
        known[name] = filters.find_latest_times_ns(each) if each else own
    for name, (at, _) in series.items():
        channel, sources = machine.channels[name], machine.channels[name].direct_source_channels
        if sources:
            if channel.differentiated_channel:
                at = at + 1  # a central difference waits for the next sample
            each = [
                filters.compute_interpolation_ready_ns(series[source][0], known[source], at)
                for source in sources
            ]
            known[name] = filters.find_latest_times_ns(each)
    return known | {"direction_x_1": known["speed_x_m_s"]}
