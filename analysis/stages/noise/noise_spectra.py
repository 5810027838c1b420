"""Robust covariances and spectra of noise, from stretches of samples, and their upper limits."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.model.windows import find_flagged_runs
from analysis.stages.noise.noise_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints

#: Number of lags, from 0, at which covariances are given.
LAGS: Final = 64
#: What a limit leaves to say of where the noise is from.
RESIDUALS: Final = "residuals"
SPREAD: Final = "spread"


class BlockSpectrum(NamedTuple):
    """Mean power (frequencies,) at `list_block_frequencies_per_sample`, and the block count."""

    power: Floats
    block_count: int


def choose_relative_noise_band(rate_hz: float) -> tuple[float, float]:
    """Lower and upper end of the frequency band that contains noise only, over the rate."""
    # faster noise leaks into the lowest frequencies of a block
    fast = min(
        max(LIMITS.fast_hz / rate_hz, LIMITS.leak_periods / LIMITS.block_samples),
        LIMITS.fast_max_rate_fraction,
    )
    return fast, min(LIMITS.fast_band_ratio * fast, 0.5)


def find_flagged_spans(flags: Bools) -> list[tuple[int, int]]:
    """First row of every run of True, and the row after its last."""
    first, last = find_flagged_runs(flags)
    return list(zip(first.tolist(), (last + 1).tolist(), strict=True))


def trim_stretch_to_settled_rows(columns: Floats, start: int, end: int) -> tuple[int, int]:
    """Trim a stretch at both ends to where the short means of all columns are level.

    The first second of a slow start may still count as standstill.

    Args:
        columns: (rows, columns), finite from `start` to `end`.
        start: first row of the stretch.
        end: row after its last.
    """
    for _ in range(LIMITS.trim_rounds):
        if end - start < LIMITS.piece_min_samples:
            break
        sums = np.cumsum(columns[start:end] - columns[start], axis=0)
        means = (
            sums[LIMITS.short_mean_samples :] - sums[: -LIMITS.short_mean_samples]
        ) / LIMITS.short_mean_samples
        off = np.abs(means - np.median(means, axis=0))
        usual = np.median(off, axis=0)
        away = np.flatnonzero(
            ((off > LIMITS.unsettled_median_distances * usual) & (usual > 0.0)).any(axis=1)
        )
        if away.size == 0:
            break
        middle = len(off) // 2
        late = away[away >= middle]
        last = end if late.size == 0 else start + int(late[0])
        early = away[away < middle]
        first = start if early.size == 0 else start + int(early[-1]) + LIMITS.short_mean_samples
        start, end = first, last
    return start, max(end, start)


def cut_into_detrended_pieces(
    columns: Floats, quiet_stretches: list[tuple[int, int]]
) -> list[Floats]:
    """Cut stretches into pieces (n, columns) without linear trends, at most about `max_pieces`.

    Args:
        columns: (rows, columns), finite in the stretches.
        quiet_stretches: stretches that contain only noise.
    """
    cut: list[Floats] = []
    long = [
        stretch
        for stretch in quiet_stretches
        if stretch[1] - stretch[0] >= LIMITS.piece_min_samples
    ]
    pieces_in_all = sum(-(-(end - start) // LIMITS.piece_max_samples) for start, end in long)
    for start, end in long[:: max(pieces_in_all // LIMITS.max_pieces, 1)]:
        parts = np.array_split(columns[start:end], -(-(end - start) // LIMITS.piece_max_samples))
        cut.extend(detrend_piece(part) for part in parts)
    return cut[:: max(len(cut) // LIMITS.max_pieces, 1)]


def detrend_piece(piece: Floats) -> Floats:
    """The piece (n, columns) without mean and linear trend of each column."""
    ramp = np.linspace(-1.0, 1.0, len(piece))[:, None]
    level = piece - piece.mean(axis=0)
    return level - ramp * ((ramp * level).sum(axis=0) / (ramp**2).sum())


def estimate_lag_covariances(pieces: list[Floats]) -> Floats:
    """E[x_i(t) x_j(t + lag)] over detrended pieces, (columns, columns, LAGS).

    Pieces in which any column varies far more than usual are left out. The part removed by the
    detrending, 2/n of the power at zero frequency, is added again.
    """
    power = np.array([(part**2).mean(axis=0) for part in pieces])
    usual = np.median(power, axis=0)
    pieces = [
        part
        for part, own in zip(pieces, power, strict=True)
        if (own <= LIMITS.event_variance_ratio * usual).all()
    ]
    if not pieces:
        return np.zeros((power.shape[1], power.shape[1], LAGS))
    lengths = np.array([len(part) for part in pieces])
    padded = np.zeros((len(pieces), pieces[0].shape[1], LIMITS.piece_max_samples + LAGS))
    for row, part in enumerate(pieces):
        padded[row, :, : len(part)] = part.T
    spectra = np.fft.rfft(padded)
    cross = np.einsum("kif,kjf->ijf", spectra.conj(), spectra)
    sums = np.fft.irfft(cross, LIMITS.piece_max_samples + LAGS)[:, :, :LAGS]
    pairs = np.maximum(lengths[:, None] - np.arange(LAGS), 0).sum(axis=0)
    found = sums / np.maximum(pairs, 1)
    lost = estimate_density_at_zero_frequency(found) * (2.0 * len(pieces) / lengths.sum())
    return np.where(pairs > 0, found + lost[:, :, None], 0.0)


def estimate_density_at_zero_frequency(covariances: Floats) -> Floats:
    """Tapered sum of the covariances over all lags, (columns, columns), variances at least 0."""
    taper = 1.0 - np.arange(1, LIMITS.correlated_lags) / LIMITS.correlated_lags
    later = covariances[:, :, 1 : LIMITS.correlated_lags] @ taper
    total = covariances[:, :, 0] + later + later.T
    own = np.sqrt(np.maximum(np.diag(total), 0.0))
    limit = np.outer(own, own)
    return np.clip(total, -limit, limit)


def choose_overlapping_block_ends(flags: Bools) -> Ints:
    """Last rows (blocks,) of half-overlapping blocks inside runs of True, about `max_blocks`."""
    rows = np.arange(flags.size)
    # the last row before the run
    begun = np.maximum.accumulate(np.where(flags, -1, rows))
    run = rows - begun
    length = LIMITS.block_samples + 2
    ends = rows[flags & (run >= length) & ((run - length) % (LIMITS.block_samples // 2) == 0)]
    return ends[:: max(ends.size // LIMITS.max_blocks, 1)]


def compute_mean_block_spectrum(
    x: Floats, block_ends: Ints, min_frequency: float
) -> BlockSpectrum | None:
    """Mean noise power of the blocks at each frequency, and their number; None if too few.

    Second differences are used, so that smooth signals do not leak, and their response is divided
    out, so that white noise of variance 1 has power 1 everywhere (0 Hz is undefined). Blocks with
    much more fast power than most contain a throttle step or a stop, and are left out.

    Args:
        x: (rows,), finite in the blocks.
        block_ends: last rows of the blocks, by `choose_overlapping_block_ends`.
        min_frequency: frequency over the rate from which power counts as fast.
    """
    if block_ends.size < LIMITS.min_blocks:
        return None
    taper = np.hanning(LIMITS.block_samples + 2)[1:-1]
    blocks = np.diff(
        np.lib.stride_tricks.sliding_window_view(x, LIMITS.block_samples + 2)[
            block_ends - LIMITS.block_samples - 1
        ],
        2,
    )
    power = np.abs(np.fft.rfft(blocks * taper)) ** 2 / (taper**2).sum()
    usual = np.median(power, axis=0)
    at = list_block_frequencies_per_sample()
    told = (at >= min_frequency) & (usual > LIMITS.stop_band_fraction * usual.max())
    if told.any():
        ratio = (power[:, told] / usual[told]).mean(axis=1)
        for _ in range(2):
            # the power of one block scatters, and of a few their median does as well
            keep = ratio <= (
                LIMITS.step_power_ratio + LIMITS.step_power_scatter / ratio.size
            ) * np.median(ratio)
            power, ratio = power[keep], ratio[keep]
    mean = power.mean(axis=0)
    mean[1:] /= (2.0 * np.sin(np.pi * at[1:])) ** 4
    mean[0] = np.nan
    return BlockSpectrum(mean, len(power))


def list_block_frequencies_per_sample() -> Floats:
    """Frequencies of `compute_mean_block_spectrum`, over the rate."""
    return np.arange(LIMITS.block_samples // 2 + 1) / LIMITS.block_samples


def average_over_neighbouring_frequencies(power: Floats, neighbours: int) -> Floats:
    """Mean power (frequencies,) of each frequency and up to `neighbours` on either side of it."""
    kernel = np.ones(2 * neighbours + 1)
    known = np.isfinite(power)
    total = np.convolve(np.where(known, power, 0.0), kernel, "same")
    return total / np.maximum(np.convolve(known.astype(float), kernel, "same"), 1.0)


def compute_cross_spectra(covariances: Floats) -> NDArray[np.complex128]:
    """Cross spectra of covariances (columns, columns, LAGS) at LAGS + 1 frequencies."""
    both = np.zeros((*covariances.shape[:2], 2 * LAGS))
    both[:, :, :LAGS] = covariances
    # E[x_i(t) x_j(t - lag)] = E[x_j(t) x_i(t + lag)]
    both[:, :, LAGS + 1 :] = covariances.transpose(1, 0, 2)[:, :, :0:-1]
    return np.fft.rfft(both)


def convert_spectra_to_covariances(spectra: NDArray[np.complex128]) -> Floats:
    """Covariances (columns, columns, LAGS) from cross spectra."""
    return np.fft.irfft(spectra, 2 * LAGS)[:, :, :LAGS]


def list_spectrum_frequencies() -> Floats:
    """Frequencies of `compute_cross_spectra`, over the rate."""
    return np.arange(LAGS + 1) / (2 * LAGS)


def find_resolution_of_column(column: Floats, chosen_rows: Bools) -> float | None:
    """Step that a column's readings are multiples of; None if it is not visible.

    Interpolated readings are not multiples, and of all values only multiples of the step recur
    often. If two rates are in step some others recur as well, but not twice in a row.
    """
    held = chosen_rows.copy()
    held[1:] &= column[1:] == column[:-1]
    step = find_quantisation_step_of_readings(column[held], int(chosen_rows.sum()))
    return (
        find_quantisation_step_of_readings(column[chosen_rows], int(chosen_rows.sum()))
        if step is None
        else step
    )


def find_quantisation_step_of_readings(readings: Floats, total_readings: int) -> float | None:
    """Step that frequently repeated readings are multiples of."""
    every = max(readings.size // LIMITS.quantisation_samples, 1)
    readings, total_readings = readings[::every], total_readings // every
    reading, times = np.unique(readings, return_counts=True)
    often = times >= LIMITS.multiple_min_times
    if often.sum() < 2 or times[often].sum() < LIMITS.multiple_min_fraction * total_readings:
        return None
    gaps = np.diff(reading[often])
    step = float(gaps.min())
    whole = gaps / step
    return step if (np.abs(whole - np.round(whole)) < LIMITS.multiple_tolerance_1).all() else None


def compute_quantisation_covariances(column: Floats, flags: Bools, step: float) -> Floats:
    """Covariances (LAGS,) of the rounding error for a step while x changes.

    On a ramp the error is a sawtooth of variance step²/12, and at a lag in which x changes by φ
    steps its covariance is 1 - 6φ(1 - φ) of that.
    """
    span = LIMITS.slope_samples
    rows = np.flatnonzero(flags[span:] & flags[:-span])
    rows = rows[:: max(rows.size // LIMITS.quantisation_samples, 1)]
    slopes = np.abs(column[rows + span] - column[rows]) / span
    if slopes.size == 0:
        slopes = np.zeros(1)
    phase = np.mod(np.arange(LAGS)[:, None] * slopes / step, 1.0)
    return step**2 / 12.0 * (1.0 - 6.0 * phase * (1.0 - phase)).mean(axis=1)


def compute_noise_std_limits_by_motion(columns: Floats, is_moving: Bools) -> tuple[Floats, Floats]:
    """Upper limits of each column's noise standard deviation, (columns,) each.

    Args:
        columns: (rows, columns) acceleration, speed and force, or those of a turn; may have gaps.
        is_moving: (rows,) whether the machine moves.

    Returns:
        The standard deviation of each column; and the residual of the force, for
        force = m a + b v + c v|v| + d sign(v) + e, divided by the column's coefficient: infinite
        for the speed, and if m is not positive.
    """
    columns = columns[is_moving]
    spread = columns.std(axis=0) if len(columns) else np.full(columns.shape[1], np.inf)
    left = np.full(columns.shape[1], np.inf)
    if columns.shape[1] == 3 and len(columns) > LIMITS.residual_min_rows:
        a, v, force = columns.T
        A = np.column_stack([a, v, v * np.abs(v), np.sign(v), np.ones(v.size)])
        theta = np.linalg.lstsq(A, force, rcond=None)[0]
        residual = float(np.sqrt(((force - A @ theta) ** 2).sum() / (len(columns) - A.shape[1])))
        if theta[0] > 0.0:
            left[0], left[2] = residual / theta[0], residual
    return spread, left


def limit_noise_covariances_in_place(
    covariances: Floats,
    sources: list[str],
    columns: Floats,
    is_moving: Bools,
    derivative_of: list[int],
) -> None:
    """Reduce the covariances of columns whose noise exceeds its upper limit, in place.

    If such a column is a derivative, those of the column that it derives from are reduced as well.

    Args:
        covariances: (columns, columns, LAGS) covariances.
        sources: source of each column's noise; noise seen at standstill is not changed.
        columns: (rows, columns) values.
        is_moving: (rows,) whether the machine moves.
        derivative_of: for each column, index of the column whose derivative it is; -1 for none.
    """
    spread, left = compute_noise_std_limits_by_motion(columns, is_moving)
    std = np.sqrt(np.maximum(np.diagonal(covariances[:, :, 0]), 0.0))
    for column, source in enumerate(sources):
        limit = min(spread[column], left[column])
        if source == "standstill" or not std[column] > LIMITS.excess_ratio * limit:
            continue
        share = limit / std[column]
        for each in {column, derivative_of[column]} - {-1}:
            if sources[each] == "standstill":
                continue
            covariances[each, :] *= share
            covariances[:, each] *= share
            std[each] *= share
            sources[each] = SPREAD if spread[column] < left[column] else RESIDUALS
