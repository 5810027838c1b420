"""First and second derivative of the force by parabolas, and the noise in them."""

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


def differentiate_force_twice(force: Floats, rate_hz: float) -> Floats:
    """Second derivative of the force by one parabola, whose noise is known, (n,) in N/s²."""
    slope = _make_slope_weights_of_bend(rate_hz)
    return _convolve_force(_convolve_force(force, slope), slope)


def _make_slope_weights_of_bend(rate_hz: float) -> Floats:
    """Weights of the slope that gives the second derivative when it is applied twice."""
    half_rows = count_rows_in_duration(LIMITS.force_bend_half_width_s, rate_hz)
    return make_parabola_slope_weights(half_rows, rate_hz)


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
    means = [np.full(length, 1.0 / length) for length in samples_per_mean]
    return np.array(
        [
            [
                max(_compute_covariance(weights, weights, autocovariance), 0.0)
                for weights in (np.convolve(mean, slope) for slope in slopes)
            ]
            for mean in means
        ]
    )


def add_force_derivatives_to_covariances(
    covariances: Floats,
    noise: ColumnNoiseModel,
    rate_hz: float,
    samples_per_mean: Sequence[int],
    *,
    has_rate_noise: bool,
) -> Floats:
    """Add the force's first and second derivative to noise covariances, before the force.

    The first one is uncorrelated with the force, since its weights change sign with time; the
    second one is not.

    Args:
        covariances: (lengths, 3, 3) noise covariance of means of acceleration, speed and force.
        noise: noise of the columns.
        rate_hz: rate of the grid.
        samples_per_mean: lengths of the means.
        has_rate_noise: whether the first derivative has noise; else values within it are 0.

    Returns:
        (lengths, parabolas, 5, 5), with one parabola if the first derivative has no noise.
    """
    slope = _make_slope_weights_of_bend(rate_hz)
    autocovariance = _list_force_autocovariances_newtons2(
        noise, max(samples_per_mean) + 2 * slope.size
    )
    rate_variances = (
        compute_force_rate_variances(noise, rate_hz, samples_per_mean)
        if has_rate_noise
        else np.zeros((len(samples_per_mean), 1))
    )
    out = np.zeros((*rate_variances.shape, 5, 5))
    kept = np.array([0, 1, 4])
    out[:, :, kept[:, None], kept] = covariances[:, None]
    out[:, :, 2, 2] = rate_variances
    for found, length in zip(out, samples_per_mean, strict=True):
        mean = np.full(length, 1.0 / length)
        bend = np.convolve(np.convolve(mean, slope), slope)
        mean = np.pad(mean, slope.size - 1)
        found[:, 3, 3] = max(_compute_covariance(bend, bend, autocovariance), 0.0)
        found[:, 3, 4] = found[:, 4, 3] = _compute_covariance(bend, mean, autocovariance)
    return out


def _compute_covariance(weights: Floats, other_weights: Floats, autocovariance: Floats) -> float:
    """Covariance of two weighted sums of one noise; both weights, (n,), are even, or both odd."""
    products = np.correlate(weights, other_weights, "full")[weights.size - 1 :]
    both_sides = 2.0 * products @ autocovariance[: weights.size]
    return float(both_sides - products[0] * autocovariance[0])


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
