"""Derivative of the force by parabolas as wide as the force allows, and its noise variance."""

from collections.abc import Sequence

import numpy as np

from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, Ints
from analysis.weighing.weighing_limits import LIMITS


def differentiate_force(force: Floats, rate_hz: float, noise_N: float) -> Floats:
    """Derivative of the force, (n,) in N/s; 0 where it is within the noise.

    Args:
        force: (n,) in N.
        rate_hz: rate of the grid.
        noise_N: standard deviation of a sample.
    """
    half_rows = count_rows_in_duration(LIMITS.force_rate_half_widths_s[0], rate_hz)
    slope = make_parabola_slope_weights(half_rows, rate_hz)
    rate, std = _convolve_force(force, slope), noise_N * float(np.sqrt(slope @ slope))
    return np.where(np.abs(rate) > LIMITS.force_rate_min_std * std, rate, 0.0)


def differentiate_force_by_widest_parabolas(
    force: Floats, rate_hz: float, noise: ColumnNoiseModel
) -> tuple[Floats, Ints]:
    """Derivative of the force by the widest parabola that agrees with all narrower ones.

    The slip term needs small rates as well: without them masses were 0.3 % off at a slip of 2 %,
    and a slip of 4 to 10 % looked like a load that grows at every start. It also needs the full
    rate when the throttle is cut; one width for all samples would either blur that or leave small
    rates in the noise (Lepskii, Theory of Probability and Its Applications 35, 1990, 454).

    Args:
        force: (n,) in N.
        rate_hz: rate of the grid.
        noise: noise of the columns.

    Returns:
        The derivative, (n,) in N/s, and the index of each sample's parabola, (n,), as in
        `compute_force_rate_variances`.
    """
    rates = [_convolve_force(force, slope) for slope in _list_parabola_slope_weights(rate_hz)]
    stds = np.sqrt(compute_force_rate_variances(noise, rate_hz, [1])[0])
    found, parabola = rates[0], np.zeros(force.size, np.int64)
    agrees = np.ones(force.size, np.bool_)
    for index, rate in enumerate(rates[1:], start=1):
        for narrower, std in zip(rates[:index], stds[:index], strict=True):
            agrees &= np.abs(rate - narrower) <= LIMITS.force_rate_agreement_std * std
        found, parabola = np.where(agrees, rate, found), np.where(agrees, index, parabola)
    return found, parabola


def compute_force_rate_variances(
    noise: ColumnNoiseModel, rate_hz: float, samples_per_mean: Sequence[int]
) -> Floats:
    """Noise variance of the force rate by length of trailing mean and by parabola, in N²/s².

    (lengths, parabolas); the lengths are `samples_per_mean`.
    """
    slopes = _list_parabola_slope_weights(rate_hz)
    autocovariance = _list_force_autocovariances_newtons2(
        noise, max(samples_per_mean) + slopes[-1].size
    )

    def compute_variance(weights: Floats) -> float:
        products = np.correlate(weights, weights, "full")[weights.size - 1 :]
        both_sides = 2.0 * products @ autocovariance[: weights.size]
        return max(float(both_sides - products[0] * autocovariance[0]), 0.0)

    means = [np.full(length, 1.0 / length) for length in samples_per_mean]
    return np.array(
        [[compute_variance(np.convolve(mean, slope)) for slope in slopes] for mean in means]
    )


def _list_force_autocovariances_newtons2(noise: ColumnNoiseModel, lag_count: int) -> Floats:
    """Autocovariance of the force's noise, (lags,) in N².

    The variance of a sum of n samples contains n - |k| pairs at lag k, so its second difference is
    twice the autocovariance at lag n.
    """
    of_sums = [
        0.0,
        *(n**2 * noise.compute_covariance_of_means(n)[2, 2] for n in range(1, lag_count + 1)),
    ]
    return np.concatenate([[of_sums[1]], np.diff(of_sums, 2) / 2.0])


def _list_parabola_slope_weights(rate_hz: float) -> list[Floats]:
    """Weights of the slope of each parabola, the narrowest (one row on either side) first."""
    wide = {count_rows_in_duration(s, rate_hz) for s in LIMITS.force_rate_half_widths_s}
    return [make_parabola_slope_weights(half_rows, rate_hz) for half_rows in sorted({1, *wide})]


def make_parabola_slope_weights(half_rows: int, rate_hz: float) -> Floats:
    """Weights of the slope of a parabola over `half_rows` rows on either side, (rows,) in 1/s."""
    row = np.arange(half_rows, -half_rows - 1, -1)
    return np.asarray(row * rate_hz / (2.0 * (np.arange(1, half_rows + 1) ** 2).sum()), np.float64)


def _convolve_force(force: Floats, weights: Floats) -> Floats:
    """Convolve the force, (n,), with an odd number of weights.

    The force is extended by its first and last value; by zeros it would begin and end with a jump.
    """
    padded = np.pad(force, weights.size // 2, mode="edge")
    return np.asarray(np.convolve(padded, weights, "valid"), np.float64)
