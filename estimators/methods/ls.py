"""Ordinary least squares (6) over sliding windows: θ = (AᵀA)⁻¹ Aᵀf with the samples of a window.

In the mean over overlapping windows, each estimate is weighted by its information on the first
parameter, ω_w ∝ 1/std²:
θ̄ = Σ_w ω_w G_w⁻¹ Σ_{k∈w} a_k f_k
The mean is linear in the force: sample k has the weight c_k = (Σ_{w∋k} ω_w G_w⁻¹) a_k. Therefore
cov θ̄ = s² Cᵀ R C, whatever the overlap.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Estimate, Trace
from estimators.interpreted import compiled_unless_short_log
from estimators.methods.method_limits import LIMITS
from estimators.numerics.autocorrelation import (
    compute_disjoint_window_residuals,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.mutual_information import sum_window_products_and_correlation
from estimators.numerics.normal_equations import extract_packed_gram, solve_packed_equations
from estimators.numerics.rolling import find_ends_of_accepted_windows, sum_window_products
from estimators.numerics.sandwich import (
    compute_all_window_stds,
    compute_one_window_stds,
    compute_sandwich_meat,
)
from estimators.numerics.small_systems import (
    compute_condition_numbers,
    compute_scaled_condition,
    factor_packed_ldl,
    invert_factored_systems,
    solve_factored_in_place,
    solve_least_squares_by_svd,
)
from estimators.threads import run_in_chunks


@dataclass(frozen=True, slots=True)
class LsOptions:
    """Options of ordinary least squares: none."""


def fit(
    A: Floats, f: Floats, options: LsOptions | None = None, autocorrelation: Floats | None = None
) -> Estimate:
    """Estimate one window by (6), in a readable form.

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: no options.
        autocorrelation: (lags,) autocorrelation of the residuals; estimated from this window if not
            given.

    Returns:
        θ with the sandwich standard deviation.
    """
    del options
    theta = solve_least_squares_by_svd(A, f)
    residual = f - A @ theta
    gram = A.T @ A
    std = compute_one_window_stds(A, gram, residual, autocorrelation)
    rms = float(np.sqrt((residual**2).mean()))
    return Estimate(theta, std, rms, float(compute_scaled_condition(gram)))


class Windows(NamedTuple):
    """Solutions of many windows, one row each.

    Attributes:
        theta: (rows, p) estimates.
        grams: (rows, p(p+1)/2) packed AᵀA, or its equivalent for the standard deviations.
        rss: (rows,) residual sums of squares.
        condition: (rows,) condition numbers.
    """

    theta: Floats
    grams: Floats
    rss: Floats
    condition: Floats

    @classmethod
    def allocate_rows(cls, rows: int, parameter_count: int) -> "Windows":
        """Allocate the solutions of `rows` windows."""
        return cls(
            np.empty((rows, parameter_count)),
            np.empty((rows, parameter_count * (parameter_count + 1) // 2)),
            np.empty(rows),
            np.empty(rows),
        )

    def store_windows(
        self, rows: slice, products: Floats, theta: Floats, grams: Floats, rss: Floats
    ) -> None:
        """Store θ (p, m), grams (entries, m) and RSS (m,) of windows with these packed products."""
        p = len(theta)
        self.theta[rows] = theta.T
        self.grams[rows] = grams.T
        self.rss[rows] = rss
        self.condition[rows] = compute_condition_numbers(products, p + 1, p)


def solve_windows(A: Floats, f: Floats, window: int, window_ends: Ints) -> Windows:
    """Solve the windows that end at `window_ends`."""
    out = Windows.allocate_rows(window_ends.size, A.shape[1])

    def solve_rows(rows: slice) -> None:
        products = sum_window_products(A, f, window, window_ends[rows])
        theta, rss = solve_windows_by_normal_equations(A, f, window, window_ends[rows], products)
        out.store_windows(rows, products, theta, extract_packed_gram(products), rss)

    run_in_chunks(solve_rows, window_ends.size)
    return out


def solve_windows_by_normal_equations(
    A: Floats, f: Floats, window: int, window_ends: Ints, products: Floats
) -> tuple[Floats, Floats]:
    """θ (p, rows) and RSS (rows,) of windows with packed products (entries, rows).

    Normal equations lose twice the digits of the condition number. For ill-conditioned windows, one
    correction by the residuals recovers half of them (Björck 1987).
    """
    solved = solve_packed_equations(products)
    theta = solved.theta
    p = len(theta)
    poor = np.flatnonzero(compute_condition_numbers(products, p + 1, p) > LIMITS.poor_condition)
    if poor.size:
        correction = compute_normal_equation_residuals(
            A, f, window, window_ends[poor], theta[:, poor]
        )
        L, inverse = np.take(solved.L, poor, axis=2), np.take(solved.inverse, poor, axis=1)
        solve_factored_in_place(L, inverse, correction)
        theta[:, poor] += correction
    return theta, solved.rss


@compiled_unless_short_log
def compute_normal_equation_residuals(
    A: Floats, f: Floats, window: int, window_ends: Ints, theta: Floats
) -> Floats:
    """Aᵀ(f - A θ) of each window, (p, rows): zero except for rounding of θ (p, rows)."""
    p = A.shape[1]
    out = np.zeros((p, window_ends.size))
    for row in range(window_ends.size):
        for k in range(window_ends[row] - window + 1, window_ends[row] + 1):
            e = f[k]
            for c in range(p):
                e -= A[k, c] * theta[c, row]
            for c in range(p):
                out[c, row] += A[k, c] * e
    return out


class WindowStatistics(NamedTuple):
    """Statistics of each window for the gate, (rows,) each.

    Attributes:
        rho: correlation of the first column and the force.
        spread: relative variance of the two (see `information`).
        predicted: sqrt(σ̂² (G⁻¹)₁₁), the textbook standard deviation of the first parameter; it
            ranks windows and is not the reported standard deviation.
        condition: condition number of the regressor.
        partial: 1 / (G⁻¹)₁₁, sum of squares of the first column after projecting out the others.
        noise_share: fraction of noise in `partial`.
    """

    rho: Floats
    spread: Floats
    predicted: Floats
    condition: Floats
    partial: Floats
    noise_share: Floats


def compute_window_statistics(
    A: Floats, f: Floats, window: int, window_ends: Ints, noise: Floats | None = None
) -> WindowStatistics:
    """Compute the gate's statistics of the windows that end at `window_ends`, in one pass.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        window: samples in a window.
        window_ends: (rows,) last samples of the windows.
        noise: (p + 1, p + 1) covariance of the noise in a row of [A f]; None for no noise.
    """
    out = WindowStatistics(*(np.empty(window_ends.size) for _ in WindowStatistics._fields))

    def fill_rows(rows: slice) -> None:
        products, *seen = sum_window_products_and_correlation(A, f, window, window_ends[rows])
        for whole, part in zip(
            out,
            (*seen, *compute_fit_statistics_of_windows(products, window, noise)),
            strict=True,
        ):
            whole[rows] = part

    run_in_chunks(fill_rows, window_ends.size)
    return out


def compute_fit_statistics_of_windows(
    products: Floats, window: int, noise: Floats | None
) -> tuple[Floats, Floats, Floats, Floats]:
    """Last four fields of `WindowStatistics`, (m,) each, from packed products (entries, m)."""
    solved = solve_packed_equations(products)
    p = len(solved.theta)
    # (G⁻¹)₁₁ is the first entry of the solution for the first unit vector
    unit = np.zeros(solved.theta.shape)
    unit[0] = 1.0
    solve_factored_in_place(solved.L, solved.inverse, unit)
    variance = solved.rss / max(window - p, 1)
    partial, share = np.empty(variance.size), np.zeros(variance.size)
    raise_variances_to_noise_in_place(
        solved.theta,
        unit,
        np.zeros((p + 1, p + 1)) if noise is None else noise,
        window,
        variance,
        partial,
        share,
    )
    return (
        np.sqrt(variance * unit[0]),
        compute_condition_numbers(products, p + 1, p),
        partial,
        share,
    )


@compiled_unless_short_log
def raise_variances_to_noise_in_place(
    theta: Floats,
    unit_variances: Floats,
    noise: Floats,
    window: int,
    variance: Floats,
    partial_sums: Floats,
    noise_fraction: Floats,
) -> None:
    """Raise variances (m,) to at least those of noise; fill in partial sums and shares (m,).

    Residuals of a window may be small by chance, but the noise is not. With u (p, m) the first
    column of G⁻¹, u / u₁ are the weights of the columns in the remainder of the first column.
    """
    p, m = theta.shape
    least = np.full(m, noise[p, p])
    for i in range(p):
        x, u = theta[i], unit_variances[i]
        own, of_force = noise[i, i], 2.0 * noise[i, p]
        for k in range(m):
            least[k] += (own * x[k] - of_force) * x[k]
            noise_fraction[k] += own * u[k] * u[k]
        for j in range(i + 1, p):
            y, w = theta[j], unit_variances[j]
            twice = 2.0 * noise[i, j]
            for k in range(m):
                least[k] += twice * x[k] * y[k]
                noise_fraction[k] += twice * u[k] * w[k]
    first = unit_variances[0]
    for k in range(m):
        variance[k] = least[k] if least[k] > variance[k] else variance[k]
        # u₁ is never zero if G has an inverse, and NaN otherwise
        partial_sums[k] = 1.0 / first[k]
        noise_fraction[k] *= window * partial_sums[k]


def compute_residual_noise_variance(theta: Floats, noise: Floats) -> Floats:
    """Noise variance (m,) of f - A θ, from θ (p, m) and the noise covariance of [A f]."""
    p = len(theta)
    own = np.einsum("ik,ij,jk->k", theta, noise[:p, :p], theta)
    shared = np.einsum("i,ik->k", noise[:p, p], theta)
    return np.maximum(own + noise[p, p] - 2.0 * shared, 0.0)


def estimate_along_log(
    A: Floats, f: Floats, window: int, accepted: Bools, options: LsOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: no options.
    """
    del options
    index = find_ends_of_accepted_windows(accepted, window)
    if index.size == 0:
        return Trace.empty(A.shape[1])
    return estimate_window_stds(A, f, window, index, solve_windows(A, f, window, index))


def estimate_window_stds(
    A: Floats, f: Floats, window: int, window_ends: Ints, solved: Windows
) -> Trace:
    """Standard deviations of solved windows, from the log's residual autocorrelation."""
    theta, grams, rss, condition = solved
    residual, owner = compute_disjoint_window_residuals(A, f, theta, window_ends, window)
    correlation, _ = estimate_pooled_autocorrelation(residual, owner, A)
    std = compute_all_window_stds(A, grams, rss, window_ends, window, correlation)
    return Trace(window_ends, theta, std, np.sqrt(rss / window), condition, correlation)


@compiled_unless_short_log
def compute_mean_sample_weights(
    A: Floats, breads: Floats, window_ends: Ints, window: int
) -> tuple[Floats, Ints]:
    """Weights c_k (n, p), and 0 for samples inside an accepted window, -1 for others, (n,).

    Breads (p, p, rows) are the windows' ω G⁻¹.
    """
    n, p = A.shape
    cover = np.zeros((p, p))
    weights = np.zeros((n, p))
    inside = np.full(n, -1, np.int64)
    begun = ended = 0
    for k in range(n):
        while begun < window_ends.size and window_ends[begun] - window + 1 <= k:
            for i in range(p):
                for j in range(p):
                    cover[i, j] += breads[i, j, begun]
            begun += 1
        while ended < begun and window_ends[ended] < k:
            for i in range(p):
                for j in range(p):
                    cover[i, j] -= breads[i, j, ended]
            ended += 1
        if begun > ended:
            inside[k] = 0
            for i in range(p):
                for j in range(p):
                    weights[k, i] += cover[i, j] * A[k, j]
        else:
            # outside all windows the sum is zero: drop the rounding error
            for i in range(p):
                for j in range(p):
                    cover[i, j] = 0.0
    return weights, inside


def average_over_windows_with_std(
    A: Floats,
    f: Floats,
    window: int,
    window_ends: Ints,
    theta: Floats,
    std: Floats,
    systematic_std: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Weighted mean of θ over all rows of a windowed trace, with its standard deviation.

    The standard deviation is exact for LS; for FGLS and TLS it is a first-order approximation with
    the weights of LS.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        window: samples in a window.
        window_ends: (rows,) last sample of each window, ascending.
        theta: (rows, p) estimates of the windows.
        std: (rows, p) standard deviations of the estimates.
        systematic_std: (rows, p) errors with the same sign in all windows, which residuals do not
            show and averaging does not reduce; None for none.

    Returns:
        (p,) mean and (p,) standard deviations, NaN if no window has an estimate.
    """
    solved = np.isfinite(theta[:, 0]) & np.isfinite(std[:, 0])
    if not solved.any():
        return np.full(A.shape[1], np.nan), np.full(A.shape[1], np.nan)
    window_ends, theta, std = window_ends[solved], theta[solved], std[solved]
    least = solve_windows(A, f, window, window_ends)
    grams = np.ascontiguousarray(least.grams.T)
    known = np.maximum(std[:, 0], np.finfo(float).tiny ** 0.25)
    share = known**-2.0 / (known**-2.0).sum()
    breads = invert_factored_systems(*factor_packed_ldl(grams, A.shape[1], A.shape[1])) * share
    weights, inside = compute_mean_sample_weights(A, breads, window_ends, window)
    # correlation of the LS residuals, since windows with extreme TLS estimates would hide it
    residual, owner = compute_disjoint_window_residuals(A, f, least.theta, window_ends, window)
    correlation, variance = estimate_pooled_autocorrelation(residual, owner, A)
    cover = compute_sandwich_meat(weights, inside, 0, 0, f.size - 1, correlation)
    white = compute_sandwich_meat(weights, inside, 0, 0, f.size - 1, np.ones(1))
    deviation = np.sqrt(np.maximum(np.diag(cover), np.diag(white)) * variance)
    if systematic_std is not None:
        deviation = np.hypot(deviation, share @ systematic_std[solved])
    return share @ theta, deviation
