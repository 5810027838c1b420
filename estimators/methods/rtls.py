"""Recursive total least squares: TLS of the discounted past, sample by sample.

The recursion keeps the discounted Gram matrix of the scaled [A f], C ← λC + z zᵀ, and recomputes
its smallest eigenvector at each sample: as p is 2 or 3, this costs no more than tracking it (Kubus,
Kröger, Wahl 2008 update a singular value decomposition instead).
"""

from dataclasses import dataclass, field

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Trace
from estimators.interpreted import compiled_unless_short_log
from estimators.methods.tls import TlsOptions, solve_scaled_tls
from estimators.numerics.autocorrelation import estimate_pooled_autocorrelation
from estimators.numerics.normal_equations import compute_residual_sums_of_squares
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
from estimators.numerics.small_systems import compute_condition_numbers, pack_symmetric_matrix


@dataclass(frozen=True, slots=True)
class RtlsOptions:
    """Noise of each column (as for TLS), and λ, the forgetting factor."""

    noise: TlsOptions = field(default_factory=TlsOptions)
    forgetting: float = 0.998


@dataclass(frozen=True, slots=True)
class RtlsState:
    """Complete state of the recursion.

    Attributes:
        theta: (p,) estimate; NaN if the past does not determine it.
        C: (p+1, p+1) discounted Gram matrix of the scaled [A f].
        weight: discounted number of samples.
    """

    theta: Floats
    C: Floats
    weight: float


def start(A: Floats, f: Floats, options: RtlsOptions | None = None) -> RtlsState:
    """Initialise from the TLS estimate of a first window: A (n, p), f (n,)."""
    options = options or RtlsOptions()
    p = A.shape[1]
    scale = options.noise.list_column_scales(p)
    z = np.column_stack([A / scale, f])
    C: Floats = z.T @ z
    return RtlsState(solve_tls_from_gram(C, options), C, float(f.size))


def step(state: RtlsState, a: Floats, f: float, options: RtlsOptions | None = None) -> RtlsState:
    """Feed one sample: row a (p,) of the regressor, and force f."""
    options = options or RtlsOptions()
    scale = options.noise.list_column_scales(a.size)
    z = np.append(a / scale, f)
    C = options.forgetting * state.C + np.outer(z, z)
    return RtlsState(solve_tls_from_gram(C, options), C, options.forgetting * state.weight + 1.0)


def solve_tls_from_gram(gram: Floats, options: RtlsOptions) -> Floats:
    """Estimate (p,) from a scaled Gram matrix; NaN if A without its noise is singular."""
    units = np.append(options.noise.list_column_scales(len(gram) - 1), 1.0)
    products = pack_symmetric_matrix(gram * np.outer(units, units)).reshape(-1, 1)
    return solve_scaled_tls(products, options.noise)[0][:, 0]


def rescale_gram_to_original_units(state: RtlsState, options: RtlsOptions) -> Floats:
    """Discounted Gram matrix (p+1, p+1) of [A f] in the original units."""
    units = np.append(options.noise.list_column_scales(len(state.theta)), 1.0)
    return state.C * np.outer(units, units)


def estimate_along_log(
    A: Floats, f: Floats, window: int, accepted: Bools, options: RtlsOptions | None = None
) -> Trace:
    """Run the recursion over the union of the accepted windows; equals repeated `step`.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: noise and forgetting.

    Returns:
        A row per accepted window: the state after its last sample. The first row is TLS of the
        first window.
    """
    options = options or RtlsOptions()
    index = find_ends_of_accepted_windows(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    first = slice(index[0] - window + 1, index[0] + 1)
    begin = start(A[first], f[first], options)
    rows, decay = index.size, options.forgetting
    theta, rms, condition = np.empty((rows, p)), np.empty(rows), np.empty(rows)
    grams = np.empty((rows, p * (p + 1) // 2))

    def store_rows(of_rows: slice, products: Floats, weight: Floats) -> None:
        x, clean = solve_scaled_tls(products, options.noise)
        theta[of_rows], grams[of_rows] = x.T, clean.T
        rms[of_rows] = np.sqrt(compute_residual_sums_of_squares(products, x) / weight)
        condition[of_rows] = compute_condition_numbers(products, p + 1, p)

    past, weight = (
        pad_entries_to_lanes(pack_symmetric_matrix(rescale_gram_to_original_units(begin, options))),
        np.array([begin.weight]),
    )
    entries = (p + 1) * (p + 2) // 2
    store_rows(slice(0, 1), past[:entries].reshape(-1, 1), weight)
    fed, seen = list_samples_fed_after_first_window(index, window)
    for of_chunk, of_rows, at_rows in iter_sample_chunks(seen):
        sums = accumulate_discounted_products(A, f, fed[of_chunk], decay, past)
        weight = count_discounted_samples(sums.shape[1], decay, float(weight[-1]))
        store_rows(of_rows, sums[:entries, at_rows], weight[at_rows])
    residual, owner = compute_residuals_of_fed_samples(A, f, theta, index, window)
    # the memory of the recursion is long, so its residuals need no correction for the fit
    correlation, variance = estimate_pooled_autocorrelation(residual, owner, None)
    one = np.zeros(window, np.int64)
    meats, white = (
        accumulate_discounted_meats(
            A, A[first], fed, seen, int(index[0]), decay, decay**2, r,
            pad_entries_to_lanes(
                pack_symmetric_matrix(compute_sandwich_meat(A[first], one, 0, 0, window - 1, r))
            ),
        )
        for r in (correlation, np.ones(1))
    )  # fmt: skip
    std = compute_recursive_sandwich_stds(grams, meats, white) * np.sqrt(variance)
    return Trace(index, theta, std, rms, condition, correlation)


@compiled_unless_short_log
def compute_residuals_of_fed_samples(
    A: Floats, f: Floats, theta: Floats, window_ends: Ints, window: int
) -> tuple[Floats, Ints]:
    """Residual of each fed sample by the state after it, (n,), with group 0, or -1 if not fed."""
    residual = np.zeros(f.size)
    fed = np.full(f.size, -1, np.int64)
    done = -1
    for row in range(window_ends.size):
        for k in range(max(done + 1, window_ends[row] - window + 1), window_ends[row] + 1):
            if np.isfinite(theta[row, 0]):
                residual[k] = f[k]
                for c in range(A.shape[1]):
                    residual[k] -= A[k, c] * theta[row, c]
                fed[k] = 0
        done = window_ends[row]
    return residual, fed
