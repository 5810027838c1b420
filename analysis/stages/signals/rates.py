"""Sampling rates of channels, and equal treatment of the channels of one regressor."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from analysis.model.machine import Machine
from analysis.model.settings import AlignSettings
from analysis.stages.signals import filters
from analysis.stages.signals.piecewise_constant import drop_values_between_steps
from analysis.stages.signals.resample import average_about_instants, interpolate_in_stretches
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats, Ints

#: Default length of a step, in periods of the channel or the grid, up to which it is not a gap.
GAP_PERIODS: Final[float] = AlignSettings.model_fields["gap_periods"].default
_TORQUES: Final = ("torque_left_N_m", "torque_right_N_m")
_WHOLE_TURN: Final = {"longitude_deg": 360.0, "roll_rad": 2 * np.pi}


class ChannelSamples(NamedTuple):
    """Samples of a channel in SI units, as `derive_channels_in_si` makes them.

    Attributes:
        t_ns: (n,) stamps, Unix time, strictly ascending; channels of one topic share the array.
        x: (n,) samples.
        known_ns: (n,) arrival times with `filter.causal`; None if they are the stamps.
    """

    t_ns: Ints
    x: Floats
    known_ns: Ints | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSeries:
    """Channel at its own stamps.

    Attributes:
        t_ns: (n,) stamps, strictly ascending.
        x: (n,) samples.
        known_ns: (n,) arrival times in a causal replay, otherwise the stamps.
        longest_ns: longest step that is not a gap.
        period_ns: mean of the steps that are not gaps.
        width_ns: averaging time of a value; 0 if values are interpolated.
        is_piecewise_constant: whether the channel has no value between two different readings.
    """

    t_ns: Ints
    x: Floats
    known_ns: Ints
    longest_ns: float
    period_ns: float
    width_ns: int
    is_piecewise_constant: bool

    def interpolate_values(self, instants_ns: Ints) -> Floats:
        """Values (rows,) at ascending instants, NaN in gaps."""
        if self.width_ns:
            values = average_about_instants(
                self.t_ns, self.x, instants_ns, self.width_ns, self.longest_ns
            )
        else:
            values = interpolate_in_stretches(self.t_ns, self.x, instants_ns, self.longest_ns)
        if self.is_piecewise_constant:
            return drop_values_between_steps(self.t_ns, self.x, instants_ns, values)
        return values

    def find_known_times_ns(self, instants_ns: Ints) -> Ints:
        """Times (rows,) in ns from which the values at these ascending instants are known."""
        return filters.compute_interpolation_ready_ns(
            self.t_ns, self.known_ns, instants_ns + self.width_ns // 2
        )

    def find_newest_known_instant_ns(self, now_ns: Ints) -> Ints:
        """Latest instant (rows,) in ns whose value was known at each time; -2⁶² if none was."""
        last = np.searchsorted(self.known_ns, now_ns, side="right") - 1
        return np.where(last >= 0, self.t_ns[last] - self.width_ns // 2, np.int64(-(2**62)))

    @property
    def typical_lag_ns(self) -> float:
        """Typical delay from an instant until its value is known."""
        if self.known_ns is self.t_ns:
            return self.width_ns / 2
        return float(np.median(self.known_ns - self.t_ns)) + self.width_ns / 2


def make_series_of_channels(
    channels: Mapping[str, ChannelSamples], machine: Machine
) -> dict[str, ChannelSeries]:
    """Series of channels from `derive`, averaged where a topic is faster than the grid."""
    series: dict[str, ChannelSeries] = {}
    for name, samples in channels.items():
        same = (each for each in series.values() if each.t_ns is samples.t_ns)
        series[name] = make_channel_series(name, samples, machine, next(same, None))
    return series


def make_channel_series(
    name: str,
    samples: ChannelSamples,
    machine: Machine,
    with_same_stamps: ChannelSeries | None = None,
) -> ChannelSeries:
    """Series of a channel; what follows from the stamps is taken from one with the same, if any."""
    t_ns, x, known_ns = samples
    if name in _WHOLE_TURN:
        # 179° and -179° are neighbours
        x = np.unwrap(x, period=_WHOLE_TURN[name])
    known_ns = t_ns if known_ns is None else known_ns
    is_piecewise_constant = machine.is_piecewise_constant(name)
    if with_same_stamps is not None:
        return replace(
            with_same_stamps, x=x, known_ns=known_ns, is_piecewise_constant=is_piecewise_constant
        )
    settings = machine.settings.align
    step_ns = 1e9 / settings.rate_hz
    longest_ns = filters.compute_gap_threshold_ns(t_ns, settings)
    period_ns = compute_mean_step_up_to_max_gap_ns(t_ns, longest_ns, step_ns)
    faster = period_ns * LIMITS.other_rate_ratio < step_ns
    return ChannelSeries(
        t_ns,
        x,
        known_ns,
        longest_ns,
        period_ns,
        width_ns=round(step_ns) if faster else 0,
        is_piecewise_constant=is_piecewise_constant,
    )


def compute_mean_period_without_gaps_ns(t_ns: Ints, step_ns: float) -> float:
    """Mean of a channel's steps that are not gaps on a grid of `step_ns`."""
    longest_ns = GAP_PERIODS * float(np.fmax(filters.compute_median_period_ns(t_ns), step_ns))
    return compute_mean_step_up_to_max_gap_ns(t_ns, longest_ns, step_ns)


def compute_mean_step_up_to_max_gap_ns(t_ns: Ints, max_gap_ns: float, step_ns: float) -> float:
    """Mean of the steps up to `max_gap_ns`; `step_ns` if there are none."""
    steps = np.diff(t_ns)
    steps = steps[steps <= max_gap_ns]
    return float(steps.mean()) if steps.size else step_ns


def wrap_angle_of_channel(channel_name: str, angle: Floats) -> Floats:
    """Wrap an angle that `make_channel_series` has unwrapped; other channels stay as they are."""
    if channel_name not in _WHOLE_TURN:
        return angle
    turn = _WHOLE_TURN[channel_name]
    return np.where(np.abs(angle) > turn / 2, angle - turn * np.round(angle / turn), angle)


def list_channel_sets_of_equations(machine: Machine) -> list[frozenset[str]]:
    """Sets of channels that share an equation: straight motion (7) and spins (8).

    One set if the two have a channel in common; without a yaw equation, straight motion only.
    """
    channels = set(machine.channels)
    kinematic = machine.settings.forces.acceleration == "kinematic"
    acceleration = "acc_x_m_s2" if kinematic else "specific_force_x_m_s2"
    force = ("force_x_N",) if "force_x_N" in channels else _TORQUES
    straight = frozenset({*force, "speed_x_m_s", "direction_x_1", acceleration})
    torque = ("torque_z_N_m",) if "torque_z_N_m" in channels else _TORQUES
    spin = frozenset({*torque, "yaw_rate_rad_s", "yaw_acc_rad_s2"})
    if not spin <= channels:
        return [straight]
    return [straight | spin] if straight & spin else [straight, spin]


def find_source_channels(channel_name: str, machine: Machine) -> frozenset[str]:
    """Measured channels that a channel is derived from, or the channel itself."""
    channel = machine.channels.get(channel_name)
    if channel is None or not channel.direct_source_channels:
        return frozenset({channel_name})
    return frozenset[str]().union(
        *(find_source_channels(each, machine) for each in channel.direct_source_channels)
    )


@dataclass(frozen=True, slots=True)
class ReducedRegressor:
    """Regressor whose channels are taken at the stamps of the slowest.

    Attributes:
        names: channels of the regressor.
        slowest: slowest channel.
        rate_hz: rate of the slowest channel.
        derived: channels that are derivatives of a slow channel, over two of its steps.
        span_ns: averaging span of the other channels about each stamp: two steps of the slow
            channel if one is derived, otherwise one step of the slowest channel.
    """

    names: frozenset[str]
    slowest: str
    rate_hz: float
    derived: frozenset[str]
    span_ns: int

    def __str__(self) -> str:
        """Note for readers of the answer on this reduction."""
        return (
            f"{self.slowest} comes at {self.rate_hz:.3g} Hz only: all of "
            f"{_join_channel_names(self.names)} are resampled at its stamps, averaged over "
            f"{self.span_ns / 1e9:.3g} s, since a slow channel among faster ones biases the "
            "estimate"
        )


def list_rate_limited_regressors(
    series: Mapping[str, ChannelSeries], machine: Machine
) -> list[ReducedRegressor]:
    """Regressors in which one channel is slower than another, or is the derivative of a slow one.

    Interpolation would low-pass the slow channel but not the others. On a grid coarser than all
    channels this does not happen.
    """
    step_ns = 1e9 / machine.settings.align.rate_hz
    found: list[ReducedRegressor] = []
    for names in list_channel_sets_of_equations(machine):
        # the sign of the speed comes with the speed
        own = sorted((names & set(series)) - {"direction_x_1"})
        least_ns = step_ns
        if max(series[name].period_ns for name in own) * LIMITS.other_rate_ratio >= step_ns:
            least_ns = min(step_ns, LIMITS.fine_step_ns)
        periods = {name: max(series[name].period_ns, least_ns) for name in own}
        slowest = max(periods, key=lambda name: periods[name])
        derived = frozenset(
            name
            for name in own
            if (channel := machine.channels.get(name))
            and channel.differentiated_channel
            and periods[name] > LIMITS.other_rate_ratio * least_ns
        )
        if derived or periods[slowest] > LIMITS.other_rate_ratio * min(periods.values()):
            # without a derived one, as long as no sample of a faster channel is left out
            span_ns = max((2 * periods[name] for name in derived), default=periods[slowest])
            rate_hz = 1e9 / periods[slowest]
            found.append(
                ReducedRegressor(names & set(series), slowest, rate_hz, derived, round(span_ns))
            )
    return found


def resample_to_slowest_channel(
    series: Mapping[str, ChannelSeries], regressor: ReducedRegressor
) -> dict[str, ChannelSeries]:
    """Take all channels of a regressor at the stamps of its slowest channel.

    Each is averaged over the same span, since single samples of a fast channel would contain its
    vibration. A derivative over two steps is such a mean already.
    """
    slowest = series[regressor.slowest]
    at_ns = slowest.t_ns
    values: dict[str, Floats] = {}
    known: list[Ints] = []
    for name in regressor.names:
        wait_ns = 0 if name in regressor.derived else regressor.span_ns // 2
        values[name] = (
            average_curved_signal(series[name], at_ns, 2 * wait_ns)
            if wait_ns
            else series[name].interpolate_values(at_ns)
        )
        known.append(series[name].find_known_times_ns(at_ns + wait_ns))
    kept = ~np.isnan(np.stack(list(values.values()))).any(axis=0)
    if kept.sum() < 2:
        # the channels do not overlap in time: `align` raises the error
        return {}
    known_ns = np.max(known, axis=0)[kept]
    return {
        name: replace(slowest, t_ns=at_ns[kept], x=x[kept], known_ns=known_ns, width_ns=0)
        for name, x in values.items()
    }


def average_curved_signal(series: ChannelSeries, instants_ns: Ints, span_ns: int) -> Floats:
    """Mean (rows,) over a span about each instant of a signal that curves between samples.

    With the curvature x'', the line between samples lies T²/12 x'' too high on average, and the
    value at the instant lies span²/24 x'' below the mean: the weighted mean of both used here has
    no such error (for three samples over a span of two steps it is Simpson's rule).
    """
    line = average_about_instants(series.t_ns, series.x, instants_ns, span_ns, series.longest_ns)
    share = span_ns**2 / (2 * series.period_ns**2 + span_ns**2)
    return share * line + (1.0 - share) * series.interpolate_values(instants_ns)


def _join_channel_names(names: frozenset[str]) -> str:
    *first, last = sorted(names - {"direction_x_1"})
    return f"{', '.join(first)} and {last}"
