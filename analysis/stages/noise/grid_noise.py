"""Noise of the grid's columns, from that of the channels before any filter.

A low-pass may leave no band in which the grid shows noise alone; the channels' own samples have
one. Their noise is assumed white and propagated by simulation: white noise takes the place of the
channels, the stages of the replay filter, differentiate and align it, and its covariances are
estimated on the grid. No formula for gaps, jitter, means and interpolation is needed.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from analysis.model.machine import Machine
from analysis.stages.noise.noise_limits import LIMITS
from analysis.stages.noise.noise_spectra import (
    LAGS,
    choose_overlapping_block_ends,
    choose_relative_noise_band,
    compute_mean_block_spectrum,
    find_resolution_of_column,
    list_block_frequencies_per_sample,
)
from analysis.stages.signals import filters, mounting, rates
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import UNFILTERED, derive_channels_in_si
from analysis.stages.signals.grid_rate import PAPER_HZ
from analysis.stages.signals.signal_limits import LIMITS as SIGNAL_LIMITS
from estimators.arrays import Floats, Ints
from estimators.errors import DataError

#: Variance of the second differences of white noise with variance 1.
_SECOND_DIFFERENCES: Final = 6.0
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class ColumnProcessing:
    """How a column is computed from a channel.

    Attributes:
        derivatives: number of differentiations.
        derivative_of: index of the column whose derivative this column is; -1 for none.
        filtered: whether the low-pass is applied.
        cutoff: cutoff frequency of the low-pass, over the rate.
        causal: whether filter and derivative use past samples only.
        rate_hz: rate of the grid.
    """

    derivatives: int
    derivative_of: int
    filtered: bool
    cutoff: float
    causal: bool
    rate_hz: float

    def compute_power_response(self, frequency_over_rate_1: Floats) -> Floats:
        """Power of unit white noise after processing, at frequencies over the rate."""
        slope = (
            2.0 * np.sin(np.pi * frequency_over_rate_1)
            if self.causal
            else np.sin(2.0 * np.pi * frequency_over_rate_1)
        )
        power = (slope * self.rate_hz) ** (2 * self.derivatives)
        if self.filtered:
            power = power * filters.compute_low_pass_power_gain(
                frequency_over_rate_1 / self.cutoff, causal=self.causal
            )
        return power

    def compute_derivative_response(self, frequency_over_rate_1: Floats) -> Complexes:
        """Transfer function of one differentiation, at frequencies over the rate."""
        if self.causal:
            return np.asarray(
                self.rate_hz * (1.0 - np.exp(-2j * np.pi * frequency_over_rate_1)), np.complex128
            )
        return self.rate_hz * 1j * np.sin(2.0 * np.pi * frequency_over_rate_1)


def flag_columns_with_noise_hidden_by_grid(
    columns: list[tuple[str, ...]], machine: Machine, channels: Mapping[str, mounting.Series]
) -> list[bool]:
    """Whether the grid hides the noise of each column.

    Args:
        columns: channels that each column is computed from.
        machine: machine file with channels, filter and grid.
        channels: raw readings by channel.
    """
    rate_hz, cutoff_hz = machine.settings.align.rate_hz, machine.settings.filter.cutoff_hz
    causal = machine.settings.filter.causal
    own_hz = {
        name: 1e9 / rates.compute_mean_period_without_gaps_ns(t, 1e9 / PAPER_HZ)
        for name, (t, _) in channels.items()
    }
    derived = any(channel.is_derivative for channel in machine.channels.values())

    def find_source_rates_hz(names: Iterable[str]) -> list[float]:
        made_of = frozenset[str]().union(
            *(rates.find_source_channels(name, machine) for name in names)
        )
        return [own_hz[name] for name in made_of if name in own_hz]

    found: list[bool] = []
    for names in columns:
        mine = find_source_rates_hz(names)
        beside = find_source_rates_hz(
            next(
                (each for each in rates.list_channel_sets_of_equations(machine) if each & {*names}),
                frozenset(names),
            )
        )
        if not mine:
            found.append(False)
            continue
        # the regressor is taken at its slowest channel's stamps, averaged over that one's steps
        mixed = min(beside) * SIGNAL_LIMITS.other_rate_ratio < min(
            max(beside), max(rate_hz, PAPER_HZ)
        )
        slow = min(beside) * SIGNAL_LIMITS.other_rate_ratio < (PAPER_HZ if derived else rate_hz)
        filtered = derived and cutoff_hz < SIGNAL_LIMITS.cutoff_max_rate_fraction * min(mine)
        top_hz = choose_relative_noise_band(rate_hz)[1] * rate_hz
        left = filters.compute_low_pass_power_gain(np.array(top_hz / cutoff_hz), causal=causal)
        stopped = filtered and float(left) < LIMITS.hidden_power_fraction
        other = derived and abs(min(mine) / rate_hz - 1.0) > LIMITS.same_rate_1
        found.append(mixed or slow or stopped or other)
    return found


def simulate_noise_covariances_on_grid(
    channels: Mapping[str, mounting.Series],
    machine: Machine,
    columns: Callable[[pl.DataFrame], Floats],
) -> Floats | None:
    """Simulate the channels' noise on the grid; return its covariances (columns, columns, LAGS).

    Args:
        channels: raw readings by channel.
        machine: machine file with the processing of channels.
        columns: function that computes the columns (rows, columns) from a grid.

    Returns:
        The covariances; None if the log is too short for a grid.
    """
    settings = machine.settings.align
    std = {
        name: estimate_white_noise_std(t, x, filters.compute_gap_threshold_ns(t, settings))
        for name, (t, x) in channels.items()
        if name not in UNFILTERED
    }
    longest_ns = max(filters.compute_gap_threshold_ns(t, settings) for t, _ in channels.values())
    part = repeat_short_log_stamps(
        select_stamps_of_simulated_rows(channels, settings.rate_hz), settings.rate_hz, longest_ns
    )
    rng = np.random.default_rng(LIMITS.simulation_seed)
    noise = {
        name: (t, std.get(name, 0.0) * rng.standard_normal(t.size)) for name, t in part.items()
    }
    try:
        x = columns(align_channels_on_grid(derive_channels_in_si(noise, machine)[0], machine)[0])
    except DataError:
        return None
    sums, pairs = sum_lagged_products_and_counts(x)
    return np.where(pairs > 0, sums / np.maximum(pairs, 1.0), 0.0)


def select_stamps_of_simulated_rows(
    channels: Mapping[str, mounting.Series], rate_hz: float
) -> dict[str, Ints]:
    """Stamps of each channel, up to `LIMITS.simulated_rows` after all channels have begun."""
    start = max(int(t[0]) for t, _ in channels.values())
    end = start + math.ceil(LIMITS.simulated_rows / rate_hz * 1e9)
    return {name: t[: max(int(np.searchsorted(t, end)), 2)] for name, (t, _) in channels.items()}


def repeat_short_log_stamps(
    stamps: Mapping[str, Ints], rate_hz: float, max_gap_ns: float
) -> dict[str, Ints]:
    """Repeat the stamps of a short log, separated by gaps, to the full number of rows."""
    last = max(int(t[-1]) for t in stamps.values())
    lasts_ns = last - min(int(t[0]) for t in stamps.values())
    every_ns = lasts_ns + math.ceil(2.0 * max_gap_ns)
    room = 1 + (np.iinfo(np.int64).max - last) // max(every_ns, 1)
    times = min(
        math.ceil(LIMITS.simulated_rows / rate_hz * 1e9 / max(lasts_ns, 1)),
        LIMITS.max_repetitions,
        room,
    )
    later_ns = np.arange(times) * every_ns
    return {name: (later_ns[:, None] + t).ravel() for name, t in stamps.items()}


def sum_lagged_products_and_counts(x: Floats) -> tuple[Floats, Floats]:
    """Sum the lagged products of columns about their means.

    Args:
        x: (n, columns) samples; a row with a NaN counts nowhere.

    Returns:
        (columns, columns, LAGS) sums, and the (LAGS,) number of pairs of rows at each lag.
    """
    known = np.asarray(np.isfinite(x).all(axis=1), np.bool_)
    x = np.where(known[:, None], x, 0.0)
    # an offset of a derived channel is not noise
    x = np.where(known[:, None], x - x.sum(axis=0) / max(int(known.sum()), 1), 0.0)
    n = next_fast_len(len(x) + LAGS, real=True)
    spectra = np.fft.rfft(x, n, axis=0)
    cross = np.einsum("fi,fj->ijf", spectra.conj(), spectra)
    seen = np.fft.rfft(known.astype(float), n)
    sums = np.fft.irfft(cross, n)[:, :, :LAGS]
    return sums, np.round(np.fft.irfft(np.abs(seen) ** 2, n)[:LAGS])


def estimate_white_noise_std(t_ns: Ints, readings: Floats, max_gap_ns: float) -> float:
    """Standard deviation of a channel's white noise, from its fast changes.

    Args:
        t_ns: (n,) stamps.
        readings: (n,) samples.
        max_gap_ns: steps longer than this are gaps.
    """
    whole = np.ones(t_ns.size, np.bool_)
    whole[1:] = np.diff(t_ns) <= max_gap_ns
    fast, top = choose_relative_noise_band(1e9 / filters.compute_median_period_ns(t_ns))
    power = compute_mean_block_spectrum(readings, choose_overlapping_block_ends(whole), fast)
    if power is None:
        second = np.diff(readings, 2)[whole[1:-1] & whole[2:]]
        variance = float((second**2).mean()) / _SECOND_DIFFERENCES if second.size else 0.0
    else:
        at = list_block_frequencies_per_sample()
        variance = float(power[0][(at >= fast) & (at <= top)].mean())
    step = find_resolution_of_column(readings, whole)
    return float(np.sqrt(max(variance, 0.0 if step is None else step**2 / 12.0)))


def list_column_processing(axis: tuple[str, ...], machine: Machine) -> list[ColumnProcessing]:
    """Processing of each column of an axis.

    Args:
        axis: names of the columns.
        machine: machine file with channels, filter and grid.
    """
    chosen = machine.settings.forces.acceleration
    channels = machine.channels
    names = [
        {"specific_force": "specific_force_x_m_s2", "kinematic": "acc_x_m_s2"}[chosen]
        if name == "regressor_acc_x_m_s2"
        else name
        for name in axis
    ]
    filtered = any(channel.is_derivative for channel in channels.values())
    cutoff = machine.settings.filter.cutoff_hz / machine.settings.align.rate_hz
    found: list[ColumnProcessing] = []
    for name in names:
        depth, at = 0, name
        while at in channels and channels[at].direct_source_channels:
            depth += channels[at].differentiated_channel is not None
            at = channels[at].direct_source_channels[0]
        parent = channels[name].differentiated_channel if name in channels else None
        found.append(
            ColumnProcessing(
                depth,
                names.index(parent) if parent in names else -1,
                filtered and cutoff < SIGNAL_LIMITS.cutoff_max_rate_fraction,
                cutoff,
                machine.settings.filter.causal,
                machine.settings.align.rate_hz,
            )
        )
    return found
