"""Recursive least squares (12)-(15) with exponential forgetting.

The recursion starts from the OLS estimate of the first accepted window with P₀ = I/σ², where σ² is
the smallest variance of the columns that vary. The printed (13)-(14) mix A and its transpose; here,
for one sample at a time: K = P a / (λ + aᵀ P a), P ← (P - K aᵀ P) / λ. Sliding windows share
samples, so each sample is fed once, over the union of the accepted windows.
"""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Trace
from estimators.methods.ls import solve_windows
from estimators.numerics import directional_forgetting as directional
from estimators.numerics.autocorrelation import (
    compute_disjoint_window_residuals,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.normal_equations import solve_packed_equations
from estimators.numerics.recursive import (
    accumulate_discounted_meats,
    accumulate_discounted_products,
    count_discounted_samples,
    iter_sample_chunks,
    list_samples_fed_after_first_window,
    pad_entries_to_lanes,
)
from estimators.numerics.rolling import find_ends_of_accepted_windows
from estimators.numerics.sandwich import compute_recursive_sandwich_stds, compute_sandwich_meat
from estimators.numerics.small_systems import (
    compute_condition_numbers,
    compute_scaled_condition,
    factor_packed_ldl,
    invert_factored_systems,
    pack_symmetric_matrix,
    solve_least_squares_by_svd,
)


@dataclass(frozen=True, slots=True)
class RlsOptions:
    """Forgetting of past samples.

    Attributes:
        forgetting: λ, factor of a sample's weight for each later sample.
        directional: forget only along the direction of the new sample (Bittanti, Bolzern, Campi
            1990), so that P does not grow along the acceleration in a long cruise.
    """

    forgetting: float = 0.998
    directional: bool = False


@dataclass(frozen=True, slots=True)
class RlsState:
    """Complete state of the recursion.

    Attributes:
        theta: (p,) estimate.
        P: (p, p) covariance factor.
        square: discounted sum of the squared residuals.
        weight: discounted number of samples.
    """

    theta: Floats
    P: Floats
    square: float
    weight: float


def start(A: Floats, f: Floats, options: RlsOptions | None = None) -> RlsState:
    """Initialise from the OLS estimate of a first window.

    Args:
        A: (n, p) regressor of the window.
        f: (n,) force.
        options: forgetting; not used here.
    """
    del options
    theta = solve_least_squares_by_svd(A, f)
    residual = f - A @ theta
    variances = A.var(axis=0)
    # a constant column (the sign of Coulomb friction while driving) would make P₀ infinite
    varying = variances[variances > 1e-12 * (A**2).mean(axis=0)]
    smallest = float(varying.min()) if varying.size else 1.0
    return RlsState(theta, np.eye(A.shape[1]) / smallest, float(residual @ residual), f.size)


def step(state: RlsState, a: Floats, f: float, options: RlsOptions | None = None) -> RlsState:
    """Feed one sample: row a (p,) of the regressor, and force f."""
    options = options or RlsOptions()
    forgetting = options.forgetting
    error = f - a @ state.theta
    Pa = state.P @ a
    r = a @ Pa
    if options.directional:
        gain = Pa / (1.0 + r)
        beta = forgetting - (1.0 - forgetting) / r if r > 0 else 0.0
        P = state.P - np.outer(Pa, Pa) * beta / (1.0 + beta * r)
    else:
        gain = Pa / (forgetting + r)
        P = (state.P - np.outer(gain, Pa)) / forgetting
    theta = state.theta + gain * error
    after = f - a @ theta
    return RlsState(
        theta,
        (P + P.T) / 2.0,
        forgetting * state.square + float(error * after),
        forgetting * state.weight + 1.0,
    )


def estimate_along_log(
    A: Floats, f: Floats, window: int, accepted: Bools, options: RlsOptions | None = None
) -> Trace:
    """Run the recursion over the union of the accepted windows; equals repeated `step`.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: forgetting.

    Returns:
        A row per accepted window: the state after its last sample. The first row is the OLS
        estimate of the first window.
    """
    options = options or RlsOptions()
    index = find_ends_of_accepted_windows(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    first = slice(index[0] - window + 1, index[0] + 1)
    begin = start(A[first], f[first], options)
    run = (
        trace_with_directional_forgetting
        if options.directional
        else _trace_with_exponential_forgetting
    )
    return run(A, f, window, index, options.forgetting, begin)


def _trace_with_exponential_forgetting(
    A: Floats, f: Floats, window: int, window_ends: Ints, forgetting: float, initial_state: RlsState
) -> Trace:
    """Solve the discounted normal equations of (12)-(15), for exponential forgetting."""
    rows, p = window_ends.size, A.shape[1]
    first = slice(window_ends[0] - window + 1, window_ends[0] + 1)
    fed, seen = list_samples_fed_after_first_window(window_ends, window)
    theta, rms, condition = np.empty((rows, p)), np.empty(rows), np.empty(rows)
    gram: Floats = np.asarray(A[first].T @ A[first], np.float64)
    theta[0], rms[0] = initial_state.theta, np.sqrt(initial_state.square / initial_state.weight)
    condition[0] = compute_scaled_condition(gram)
    past, weight = (
        pad_entries_to_lanes(pack_symmetric_matrix(initial_gram_matrix(initial_state))),
        np.array([initial_state.weight]),
    )
    entries = (p + 1) * (p + 2) // 2
    for of_chunk, of_rows, at_rows in iter_sample_chunks(seen):
        sums = accumulate_discounted_products(A, f, fed[of_chunk], forgetting, past)
        solved = solve_packed_equations(sums[:entries])
        weight = count_discounted_samples(sums.shape[1], forgetting, float(weight[-1]))
        theta[of_rows] = np.take(solved.theta, at_rows, axis=1).T
        rms[of_rows] = np.sqrt(solved.rss[at_rows] / weight[at_rows])
        condition[of_rows] = compute_condition_numbers(np.take(sums, at_rows, axis=1), p + 1, p)
    correlation, variance = estimate_window_autocorrelation(A, f, window, window_ends)
    # P₀⁻¹ θ₀ is linear in the first window's force: what stands for A there
    R = np.diag(1.0 / np.diagonal(initial_state.P))
    as_fed: Floats = np.ascontiguousarray(A[first] @ (np.linalg.pinv(gram) @ R))
    std = compute_recursion_stds(A, as_fed, window_ends, fed, seen, forgetting, R, correlation)
    return Trace(window_ends, theta, std * np.sqrt(variance), rms, condition, correlation)


def estimate_window_autocorrelation(
    A: Floats, f: Floats, window: int, window_ends: Ints
) -> tuple[Floats, float]:
    """Residual autocorrelation and variance of separately fitted windows.

    It stands for that of the recursion's residuals, which is unknown.
    """
    least = solve_windows(A, f, window, window_ends).theta
    return estimate_pooled_autocorrelation(
        *compute_disjoint_window_residuals(A, f, least, window_ends, window), A
    )


def initial_gram_matrix(state: RlsState) -> Floats:
    """Discounted Gram matrix of [A f], (p+1, p+1), that is equivalent to an initial state."""
    R = np.diag(1.0 / np.diagonal(state.P))
    h = R @ state.theta
    return np.block([[R, h[:, None]], [h[None, :], np.array([[state.square + state.theta @ h]])]])


def compute_recursion_stds(
    A: Floats,
    first_window: Floats,
    window_ends: Ints,
    fed_samples: Ints,
    fed_count: Ints,
    forgetting: float,
    inverse_covariances: Floats,
    correlation: Floats,
) -> Floats:
    """Standard deviations (rows, p) for residuals of variance 1: diag R⁻¹ M R⁻¹, R = P⁻¹."""
    one, none, start = np.zeros(len(first_window), np.int64), np.ones(1), int(window_ends[0])
    meats, white = (
        accumulate_discounted_meats(
            A, first_window, fed_samples, fed_count, start, forgetting, forgetting**2, r,
            pad_entries_to_lanes(
                pack_symmetric_matrix(
                    compute_sandwich_meat(first_window, one, 0, 0, len(first_window) - 1, r)
                )
            ),
        )
        for r in (correlation, none)
    )  # fmt: skip
    bread = accumulate_discounted_meats(
        A,
        first_window,
        fed_samples,
        fed_count,
        start,
        forgetting,
        forgetting,
        none,
        pad_entries_to_lanes(pack_symmetric_matrix(inverse_covariances)),
    )
    return compute_recursive_sandwich_stds(bread, meats, white)


def trace_with_directional_forgetting(
    A: Floats, f: Floats, window: int, window_ends: Ints, forgetting: float, initial_state: RlsState
) -> Trace:
    """Run the recursion with directional forgetting."""
    p = A.shape[1]
    first = slice(window_ends[0] - window + 1, window_ends[0] + 1)
    sums = (initial_state.square, initial_state.weight)
    theta, rms, P, _ = directional.run_recursion_over_windows(
        A, f, window, window_ends, forgetting, initial_state.theta, initial_state.P, sums
    )
    correlation, variance = estimate_window_autocorrelation(A, f, window, window_ends)
    gram = A[first].T @ A[first]
    bread: Floats = np.asarray(np.linalg.pinv(gram), np.float64)
    B = compute_sandwich_meat(A[first], np.zeros(window, np.int64), 0, 0, window - 1, correlation)
    cover: Floats = np.asarray(bread @ B @ bread, np.float64)
    ahead = np.zeros((correlation.size, p))
    for j in range(correlation.size - 1):
        # samples of the first window that are correlated with the residual j + 1 after it
        near = correlation[j + 1 :][:window]
        ahead[j] = bread @ (near @ A[first][::-1][: near.size])
    std = directional.compute_recursive_estimate_stds(
        A, window, window_ends, forgetting, initial_state.P, cover, ahead, correlation
    )
    # a tapered correlation need not be positive definite: never below uncorrelated residuals
    none = np.zeros((1, p))
    white = directional.compute_recursive_estimate_stds(
        A, window, window_ends, forgetting, initial_state.P, bread, none, np.ones(1)
    )
    std = np.maximum(std, white) * np.sqrt(variance)
    upper = np.triu_indices(p)
    R = invert_factored_systems(*factor_packed_ldl(np.ascontiguousarray(P[:, *upper].T), p, p))[
        upper
    ]
    condition = compute_condition_numbers(R, p, p)
    condition[0] = compute_scaled_condition(gram)
    return Trace(window_ends, theta, std, rms, condition, correlation)
