"""The estimators sample by sample: state in, state out, bounded work, same θ as in replay.

Every function here forms the same sums as the compiled `estimate_along_log` for the current window,
in the same order, and calls the same loops for one window, so that θ equals the replay's bit for
bit. Standard deviations differ, since the residuals' autocorrelation over the log is not known yet:
residuals are assumed to be white noise after a moving mean of `samples_per_mean` samples, and the
regressor constant over that span, so that the textbook variance is `samples_per_mean` times larger.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.estimate import Estimate
from estimators.interpreted import compiled_unless_short_log
from estimators.methods import rls as recursion
from estimators.methods import rtls as total_recursion
from estimators.methods.fgls import FglsOptions
from estimators.methods.fgls import solve_windows_by_reweighting as reweight_fgls
from estimators.methods.huber import HuberOptions
from estimators.methods.huber import solve_windows_robustly as reweight_huber
from estimators.methods.ls import (
    LsOptions,
    WindowStatistics,
    compute_fit_statistics_of_windows,
    solve_windows_by_normal_equations,
)
from estimators.methods.pooled import PooledOptions, add_one_sample_product, subtract_expected_noise
from estimators.methods.rls import RlsOptions, RlsState
from estimators.methods.rtls import RtlsOptions
from estimators.methods.tls import TlsOptions, solve_scaled_tls
from estimators.numerics import directional_forgetting
from estimators.numerics.mutual_information import fill_correlation_and_relative_variance
from estimators.numerics.normal_equations import (
    compute_residual_sums_of_squares,
    count_columns_of_packed_products,
    extract_packed_gram,
    solve_packed_equations,
)
from estimators.numerics.recursive import (
    accumulate_discounted_products,
    count_discounted_samples,
    pad_entries_to_lanes,
)
from estimators.numerics.rolling import (
    convert_centred_moments_to_products,
    count_padded_lanes,
    fill_centred_terms,
    fill_suffix_sums,
)
from estimators.numerics.small_systems import (
    compute_condition_numbers,
    compute_scaled_condition,
    invert_positive_definite,
    pack_symmetric_matrix,
    unpack_leading_block,
)


class WindowState(NamedTuple):
    """The current window, and the sums of the two scans (see `estimators.numerics.rolling`).

    Attributes:
        z: (p + 1, window) columns of [A f], the oldest sample first.
        seen: number of samples so far.
        centre: (p + 1,) last sample of the last complete block.
        suffix: (lanes, window) sums from each sample of that block to its end.
        prefix: (lanes,) sums of the samples after that block.
        products: (entries, 1) packed sums of the window's products; NaN until it is complete.
        moments: (lanes, 1) centred form of these sums; NaN until the window is complete.
    """

    z: Floats
    seen: int
    centre: Floats
    suffix: Floats
    prefix: Floats
    products: Floats
    moments: Floats


def make_empty_window(parameter_count: int, window: int) -> WindowState:
    """Empty state before the first sample."""
    q = parameter_count + 1
    entries = q * (q + 1) // 2
    lanes = count_padded_lanes(q + entries)
    return WindowState(
        np.full((q, window), np.nan),
        0,
        np.full(q, np.nan),
        np.full((lanes, window), np.nan),
        np.zeros(lanes),
        np.full((entries, 1), np.nan),
        np.full((lanes, 1), np.nan),
    )


@compiled_unless_short_log
def advance_window(state: WindowState, sample: Floats) -> WindowState:
    """Advance by one sample (p + 1,): the regressor's row, then the force.

    Every `window` samples the suffix sums are recomputed, with as many additions.
    """
    q, window = state.z.shape
    z = np.empty((q, window))
    z[:, : window - 1] = state.z[:, 1:]
    z[:, window - 1] = sample
    seen = state.seen + 1
    centre, suffix, prefix = state.centre, state.suffix, state.prefix.copy()
    since = seen % window
    if since == 0:
        centre = sample.copy()
        terms = np.zeros((suffix.shape[0], window))
        fill_centred_terms(z, centre, window, terms)
        suffix = np.empty((suffix.shape[0], window))
        fill_suffix_sums(terms, window, suffix)
        prefix[:] = 0.0
    else:
        terms = np.zeros((suffix.shape[0], 1))
        fill_centred_terms(sample.copy().reshape(q, 1), centre, 1, terms)
        for lane in range(prefix.size):
            prefix[lane] += terms[lane, 0]
    products, moments = state.products, state.moments
    if seen >= window:
        moments = np.empty((prefix.size, 1))
        for lane in range(prefix.size):
            moments[lane, 0] = suffix[lane, since] + prefix[lane]
        products = np.empty(state.products.shape)
        convert_centred_moments_to_products(moments, centre, window, 0, 1, products)
    return WindowState(z, seen, centre, suffix, prefix, products, moments)


def compute_window_statistics_for_gate(
    states: Sequence[WindowState], noise: Floats | None = None
) -> WindowStatistics:
    """Gate statistics of m windows, (m,) each; `noise` as in `ls.compute_window_statistics`."""
    window = states[0].z.shape[1]
    rho, spread = np.empty(len(states)), np.empty(len(states))
    for k, state in enumerate(states):
        own = rho[k : k + 1], spread[k : k + 1]
        fill_correlation_and_relative_variance(state.moments, state.centre, window, *own)
    products = np.hstack([state.products for state in states])
    return WindowStatistics(
        rho, spread, *compute_fit_statistics_of_windows(products, window, noise)
    )


def estimate_by_ls(state: WindowState, samples_per_mean: int, options: LsOptions) -> Estimate:  # noqa: ARG001 - all methods take some
    """Ordinary least squares of the current window."""
    A, f, end = unroll_window_to_samples(state)
    theta, _ = solve_windows_by_normal_equations(A, f, f.size, end, state.products)
    return make_window_estimate(state, theta, extract_packed_gram(state.products), samples_per_mean)


def estimate_by_fgls(state: WindowState, samples_per_mean: int, options: FglsOptions) -> Estimate:
    """Feasible generalised least squares of the current window: O(window)."""
    A, f, end = unroll_window_to_samples(state)
    theta = reweight_fgls(A, f, f.size, end, state.products, options)
    return make_window_estimate(state, theta, extract_packed_gram(state.products), samples_per_mean)


def estimate_by_tls(state: WindowState, samples_per_mean: int, options: TlsOptions) -> Estimate:
    """Total least squares of the current window."""
    return make_window_estimate(state, *solve_scaled_tls(state.products, options), samples_per_mean)


def estimate_by_huber(state: WindowState, samples_per_mean: int, options: HuberOptions) -> Estimate:
    """Huber regression of the current window: at most a hundred steps of O(window)."""
    A, f, end = unroll_window_to_samples(state)
    theta, residuals = reweight_huber(A, f, f.size, end, state.products, options)
    return make_window_estimate(
        state, theta, extract_packed_gram(state.products), samples_per_mean, residuals.squares
    )


def unroll_window_to_samples(state: WindowState) -> tuple[Floats, Floats, Ints]:
    """The window as a log: A (window, p), f (window,) and its end (1,)."""
    A = np.ascontiguousarray(state.z[:-1].T)
    return A, state.z[-1].copy(), np.array([state.z.shape[1] - 1])


def make_window_estimate(
    state: WindowState,
    theta: Floats,
    G: Floats,
    samples_per_mean: int,
    raised_rss: Floats | None = None,
) -> Estimate:
    """Estimate of one window from θ (p, 1), packed AᵀA (entries, 1) and RSS (1,)."""
    q, window = state.z.shape
    p = q - 1
    rss = compute_residual_sums_of_squares(state.products, theta)
    return Estimate(
        theta[:, 0].copy(),
        compute_homoscedastic_stds(
            G[:, 0], p, rss if raised_rss is None else raised_rss, window, samples_per_mean
        ),
        float(np.sqrt(rss[0] / window)),
        float(compute_condition_numbers(state.products, q, p)[0]),
    )


def compute_homoscedastic_stds(
    G: Floats, p: int, rss: Floats, samples: int, samples_per_mean: int
) -> Floats:
    """Textbook standard deviations (p,), counting `samples_per_mean` residual samples as one."""
    degrees_of_freedom = samples - p * samples_per_mean
    variance = rss[0] / degrees_of_freedom * samples_per_mean if degrees_of_freedom > 0 else np.nan
    return np.sqrt(variance * np.diagonal(invert_positive_definite(unpack_leading_block(G, p, p))))


@dataclass(frozen=True, slots=True)
class WindowHistory:
    """Past samples of a recursive estimator, as discounted sums.

    Attributes:
        products: (lanes,) packed, discounted products of the columns of [A f].
        squares: (lanes,) the same products discounted by λ², for the variance of Aᵀf.
        weight: discounted number of samples.
    """

    products: Floats
    squares: Floats
    weight: float


def _add_new_samples_to_history(
    state: WindowState, past: WindowHistory, new_samples: int, forgetting: float
) -> WindowHistory:
    """Add the newest samples of the window to the history."""
    A, f, _ = unroll_window_to_samples(state)
    fed = np.arange(f.size - new_samples, f.size)
    products, squares = past.products.copy(), past.squares.copy()
    accumulate_discounted_products(A, f, fed, forgetting, products)
    accumulate_discounted_products(A, f, fed, forgetting**2, squares)
    return WindowHistory(
        products, squares, float(count_discounted_samples(new_samples, forgetting, past.weight)[-1])
    )


def make_recursive_estimate(
    theta: Floats,
    past: WindowHistory,
    R: Floats,
    rss: float,
    samples_per_mean: int,
    condition: float,
) -> Estimate:
    """Estimate from θ = R⁻¹ Aᵀf, whose errors are R⁻¹ (p, p) times the errors of Aᵀf."""
    p = theta.size
    bread = invert_positive_definite(R)
    M = unpack_leading_block(past.squares, p + 1, p)
    std = np.sqrt(rss / past.weight * samples_per_mean * np.diagonal(bread @ M @ bread))
    return Estimate(theta, std, float(np.sqrt(rss / past.weight)), condition)


def estimate_by_rls(
    state: WindowState,
    past: WindowHistory | RlsState | None,
    new_samples: int,
    samples_per_mean: int,
    options: RlsOptions,
) -> tuple[WindowHistory | RlsState, Estimate]:
    """Feed the newest samples of an accepted window, or start with its OLS estimate.

    Args:
        state: the window.
        past: state after the previous accepted window; None for the first.
        new_samples: number of samples that were in no accepted window before.
        samples_per_mean: length of the moving mean in samples.
        options: forgetting; with directional forgetting `past` is an `RlsState`.
    """
    if options.directional:
        assert not isinstance(past, WindowHistory)
        return _step_directional_rls(state, past, new_samples, samples_per_mean, options)
    assert not isinstance(past, RlsState)
    return _step_exponential_rls(state, past, new_samples, samples_per_mean, options)


def _step_exponential_rls(
    state: WindowState,
    past: WindowHistory | None,
    new_samples: int,
    samples_per_mean: int,
    options: RlsOptions,
) -> tuple[WindowHistory, Estimate]:
    """One step of RLS with exponential forgetting; the first starts from the window."""
    p = len(state.z) - 1
    entries = len(state.products)
    if past is None:
        A, f, _ = unroll_window_to_samples(state)
        start = recursion.start(A, f, options)
        R = np.diag(1.0 / np.diagonal(start.P))
        G = unpack_leading_block(state.products[:, 0], p + 1, p)
        squares = np.zeros((p + 1, p + 1))
        squares[:p, :p] = R @ invert_positive_definite(G) @ R
        past = WindowHistory(
            pad_entries_to_lanes(pack_symmetric_matrix(recursion.initial_gram_matrix(start))),
            pad_entries_to_lanes(pack_symmetric_matrix(squares)),
            start.weight,
        )
        theta, rss, condition = start.theta, start.square, compute_scaled_condition(G)
    else:
        past = _add_new_samples_to_history(state, past, new_samples, options.forgetting)
        solved = solve_packed_equations(past.products[:entries].reshape(-1, 1))
        R = unpack_leading_block(past.products, p + 1, p)
        theta, rss = solved.theta[:, 0], float(solved.rss[0])
        condition = compute_scaled_condition(R)
    return past, make_recursive_estimate(theta, past, R, rss, samples_per_mean, condition)


def _step_directional_rls(
    state: WindowState,
    past: RlsState | None,
    new_samples: int,
    samples_per_mean: int,
    options: RlsOptions,
) -> tuple[RlsState, Estimate]:
    """One step of RLS with directional forgetting; the first starts from the window."""
    A, f, _ = unroll_window_to_samples(state)
    if past is None:
        past = recursion.start(A, f, options)
        p = past.theta.size
        R = unpack_leading_block(state.products[:, 0], p + 1, p)
    else:
        ends = np.array([f.size - 1 - new_samples, f.size - 1])
        theta, _, P, sums = directional_forgetting.run_recursion_over_windows(
            A, f, f.size, ends, options.forgetting, past.theta, past.P, (past.square, past.weight)
        )
        past = RlsState(theta[-1], P[-1], *sums)
        R = invert_positive_definite(past.P)
    rms = float(np.sqrt(max(past.square, 0.0) / past.weight))
    std = rms * np.sqrt(samples_per_mean * np.diagonal(invert_positive_definite(R)))
    return past, Estimate(past.theta, std, rms, compute_scaled_condition(R))


def estimate_by_rtls(
    state: WindowState,
    past: WindowHistory | None,
    new_samples: int,
    samples_per_mean: int,
    options: RtlsOptions,
) -> tuple[WindowHistory, Estimate]:
    """Recursive total least squares; the arguments are those of `estimate_by_rls`."""
    p, entries = len(state.z) - 1, len(state.products)
    if past is None:
        A, f, _ = unroll_window_to_samples(state)
        start = total_recursion.start(A, f, options)
        products = pad_entries_to_lanes(
            pack_symmetric_matrix(total_recursion.rescale_gram_to_original_units(start, options))
        )
        past = WindowHistory(products, pad_entries_to_lanes(state.products[:, 0]), start.weight)
    else:
        past = _add_new_samples_to_history(state, past, new_samples, options.forgetting)
    products = past.products[:entries].reshape(-1, 1)
    theta, clean = solve_scaled_tls(products, options.noise)
    rss = float(compute_residual_sums_of_squares(products, theta)[0])
    condition = float(compute_condition_numbers(products, p + 1, p)[0])
    R = unpack_leading_block(clean[:, 0], p, p)
    return past, make_recursive_estimate(theta[:, 0], past, R, rss, samples_per_mean, condition)


@dataclass(frozen=True, slots=True)
class Pool:
    """Samples of the current manoeuvre: packed products (entries,), and their number."""

    products: Floats
    samples: int

    def add(self, sample: Floats) -> "Pool":
        """Add one sample (p + 1,)."""
        products = self.products.copy()
        add_one_sample_product(sample[:-1].copy(), sample[-1], products)
        return Pool(products, self.samples + 1)

    def estimate(self, samples_per_mean: int, options: PooledOptions) -> Estimate:
        """Least squares over all samples of the pool."""
        products = self.products.reshape(-1, 1)
        counts = np.array([float(self.samples)])
        theta, p = (
            solve_packed_equations(subtract_expected_noise(products, counts, options)).theta,
            count_columns_of_packed_products(products) - 1,
        )
        rss = compute_residual_sums_of_squares(products, theta)
        return Estimate(
            theta[:, 0],
            compute_homoscedastic_stds(
                extract_packed_gram(products)[:, 0], p, rss, self.samples, samples_per_mean
            ),
            float(np.sqrt(rss[0] / self.samples)),
            float(compute_condition_numbers(products, p + 1, p)[0]),
        )


def make_empty_pool(parameter_count: int) -> Pool:
    """Empty pool before the first sample."""
    return Pool(np.zeros((parameter_count + 1) * (parameter_count + 2) // 2), 0)
