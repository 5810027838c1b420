"""Total least squares over sliding windows, on columns scaled by their noise.

In raw units TLS fails if the units differ in size. With every column of [A f] divided by its noise,
the estimate is the smallest singular direction of the window; if A without its noise is singular
(too little motion), there is no estimate, and θ is NaN. From the Gram matrix: θ solves
(G - λI) θ = h with λ the smallest root of φ(λ) = fᵀf - λ - hᵀ(G - λI)⁻¹h.
"""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Estimate, Trace
from estimators.interpreted import compiled_unless_short_log
from estimators.methods import ls
from estimators.methods.method_limits import LIMITS
from estimators.numerics.normal_equations import (
    compute_residual_sums_of_squares,
    count_columns_of_packed_products,
    extract_packed_gram,
)
from estimators.numerics.rolling import find_ends_of_accepted_windows, sum_window_products
from estimators.numerics.sandwich import compute_one_window_stds
from estimators.numerics.small_systems import (
    compute_scaled_condition,
    factor_packed_ldl,
    find_packed_index,
    make_packed_index_table,
    pack_symmetric_matrix,
    solve_factored_in_place,
    solve_positive_definite,
)
from estimators.threads import run_in_chunks

#: Change of λ, relative to fᵀf, that counts as rounding.
_SETTLED = 1e-14


@dataclass(frozen=True, slots=True)
class TlsOptions:
    """Noise of the columns of A, in order, and of f; only the ratios matter.

    The third column is the Coulomb sign, which is nearly exact.
    """

    noise_A: tuple[float, ...] = (0.01, 0.005, 0.001)
    noise_f: float = 60.0

    def list_column_scales(self, parameter_count: int) -> Floats:
        """(p,) noise of the columns of A over that of f."""
        return np.array(self.noise_A[:parameter_count]) / self.noise_f


def fit(
    A: Floats, f: Floats, options: TlsOptions | None = None, autocorrelation: Floats | None = None
) -> Estimate:
    """Estimate one window by the singular value decomposition of the scaled [A f].

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: noise of each column.
        autocorrelation: (lags,) autocorrelation of the residuals; estimated from this window if not
            given.
    """
    options = options or TlsOptions()
    p = A.shape[1]
    scale = options.list_column_scales(p)
    scaled = A / scale
    _, s, Vt = np.linalg.svd(np.column_stack([scaled, f]), full_matrices=False)
    theta = -Vt[-1, :p] / Vt[-1, p] / scale
    residual = f - A @ theta
    gram = (scaled.T @ scaled - s[-1] ** 2 * np.eye(p)) * np.outer(scale, scale)
    std = compute_one_window_stds(A, gram, residual, autocorrelation)
    theta = np.where(np.isnan(solve_positive_definite(gram, gram[0])), np.nan, theta)
    rms = float(np.sqrt((residual**2).mean()))
    return Estimate(theta, std, rms, float(compute_scaled_condition(A.T @ A)))


def solve_scaled_tls(products: Floats, options: TlsOptions) -> tuple[Floats, Floats]:
    """Total least squares of m windows from their packed products (entries, m).

    The smallest root of φ is found by Newton's method (Rayleigh quotients) inside a shrinking
    bracket. φ is decreasing and concave up to the smallest eigenvalue of G; a step may overshoot
    that eigenvalue, so that G - λI is not positive definite, and then the bracket is halved.

    Returns:
        (p, m) θ, NaN if A without its noise is singular, and packed AᵀA without that noise,
        (p(p+1)/2, m).
    """
    q = count_columns_of_packed_products(products)
    p, m = q - 1, products.shape[1]
    scale = np.append(options.list_column_scales(p), 1.0)
    units = pack_symmetric_matrix(np.outer(scale, scale))[:, None]
    C = products / units
    shifted = C.copy()
    # λ and the bracket around it
    roots = np.zeros((3, m))
    roots[2] = np.inf
    done = np.zeros(m, np.bool_)
    x = solve_tls_normal_equations(C, shifted, roots[0])
    for _ in range(LIMITS.root_max_steps):
        if update_eigenvalues_by_newton_step(C, x, roots, done):
            break
        x = solve_tls_normal_equations(C, shifted, roots[0])
    return x / scale[:p, None], extract_packed_gram(shifted * units)


def solve_tls_normal_equations(
    augmented_gram: Floats, shifted_gram_out: Floats, eigenvalue: Floats
) -> Floats:
    """Solve (G - λI) x = h for x (p, m) at the present λ (m,); `shifted_gram_out` gets G - λI."""
    q = count_columns_of_packed_products(augmented_gram)
    rows = make_packed_index_table(q)
    for i in range(q - 1):
        shifted_gram_out[rows[i][i]] = augmented_gram[rows[i][i]] - eigenvalue
    x = augmented_gram[list(rows[q - 1][: q - 1])]
    solve_factored_in_place(*factor_packed_ldl(shifted_gram_out, q, q - 1), x)
    return x


@compiled_unless_short_log
def update_eigenvalues_by_newton_step(gram: Floats, x: Floats, roots: Floats, done: Bools) -> bool:
    """Update λ and its bracket (3, m) where not `done` (m,); return whether all are done.

    A step below rounding is skipped, so that x (p, m) stays the solution for λ.
    """
    p, m = x.shape
    lam, low, high = roots[0], roots[1], roots[2]
    ff = gram[find_packed_index(p, p, p + 1)]
    value = np.empty(m)
    slope = np.ones(m)
    for k in range(m):
        value[k] = ff[k] - lam[k]
    for i in range(p):
        h, solution = gram[find_packed_index(i, p, p + 1)], x[i]
        for k in range(m):
            value[k] -= h[k] * solution[k]
            slope[k] += solution[k] * solution[k]
    unsettled = 0
    for k in range(m):
        above = value[k] > 0.0
        down = lam[k] if above else low[k]
        up = high[k] if above else lam[k]
        following = lam[k] + value[k] / slope[k]
        inside = following >= down and following <= up
        following = following if inside else 0.5 * (down + up)
        settled = done[k] or abs(following - lam[k]) <= _SETTLED * ff[k] or np.isnan(following)
        low[k] = down
        high[k] = up
        lam[k] = lam[k] if settled else following
        done[k] = settled
        unsettled += 0 if settled else 1
    return unsettled == 0


def solve_windows(
    A: Floats, f: Floats, window: int, window_ends: Ints, options: TlsOptions
) -> ls.Windows:
    """Solve the windows that end at `window_ends`."""
    out = ls.Windows.allocate_rows(window_ends.size, A.shape[1])

    def solve_rows(rows: slice) -> None:
        products = sum_window_products(A, f, window, window_ends[rows])
        theta, clean = solve_scaled_tls(products, options)
        out.store_windows(
            rows, products, theta, clean, compute_residual_sums_of_squares(products, theta)
        )

    run_in_chunks(solve_rows, window_ends.size)
    return out


def estimate_along_log(
    A: Floats, f: Floats, window: int, accepted: Bools, options: TlsOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: noise of each column.
    """
    options = options or TlsOptions()
    index = find_ends_of_accepted_windows(accepted, window)
    if index.size == 0:
        return Trace.empty(A.shape[1])
    return ls.estimate_window_stds(A, f, window, index, solve_windows(A, f, window, index, options))
