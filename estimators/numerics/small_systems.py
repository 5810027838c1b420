"""Many small symmetric systems at once: p is 2 or 3, the windows are thousands.

The last axis of every array is over the systems, so that inner loops do one operation on all of
them, which the compiler vectorises; the order of operations within a system is the same as for a
single one. A symmetric matrix is packed: its upper triangle row by row, with entry (i, j) in row
`find_packed_index(i, j, size)`.
"""

from functools import cache

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form

#: Ratio of a pivot to its diagonal below which columns are dependent to working precision.
DEPENDENT = 1e-14
#: Sum of squares below which a column is 0 except for rounding (a filter that rings out), so that
#: a division by it would overflow.
NOTHING = 1e-60
#: Sweeps of Jacobi rotations after which a 3 × 3 matrix is diagonal (it converges quadratically).
_SWEEPS = 6


def solve_least_squares_by_svd(A: Floats, f: Floats) -> Floats:
    """Least-squares solution of A θ = f, (p,), by SVD, for the readable forms."""
    return np.asarray(np.linalg.lstsq(A, f, rcond=None)[0], np.float64)


def factor_covariance(covariance: Floats) -> Floats:
    """Lower triangular L with L Lᵀ = the covariance (p, p), which may be singular."""
    try:
        return np.asarray(np.linalg.cholesky(covariance), np.float64)
    except np.linalg.LinAlgError:
        # rounding may make a variance of 0 negative
        variances, directions = np.linalg.eigh(covariance)
        upper = np.linalg.qr((directions * np.sqrt(np.maximum(variances, 0.0))).T)[1]
        return np.asarray(upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0), np.float64)


@compiled_unless_short_log
def find_packed_index(i: int, j: int, size: int) -> int:
    """Row of entry (i, j), i <= j, in a packed symmetric matrix of `size` columns."""
    return i * size - i * (i - 1) // 2 + j - i


def _factor_packed_ldl_vectorised(G: Floats, size: int, p: int) -> tuple[Floats, Floats]:
    L, inverse = np.zeros((p, p, G.shape[1])), np.empty((p, G.shape[1]))
    for i in range(p):
        diagonal = G[find_packed_index(i, i, size)]
        pivot = diagonal.copy()
        for j in range(i):
            lower = G[find_packed_index(j, i, size)].copy()
            for r in range(j):
                lower -= L[j, r] * L[r, i]
            L[j, i] = lower
            L[i, j] = lower * inverse[j]
            pivot -= L[i, j] * L[j, i]
        regular = (pivot > DEPENDENT * diagonal) & (diagonal > NOTHING)
        inverse[i] = np.where(regular, 1.0 / pivot, np.nan)
    return L, inverse


@compiled_with_array_form(_factor_packed_ldl_vectorised)
def factor_packed_ldl(G: Floats, size: int, leading_size: int) -> tuple[Floats, Floats]:
    """Factor the leading p × p of m packed matrices, G = L D Lᵀ; NaN where one is singular.

    It uses no square roots and does not depend on the columns' units.

    Args:
        G: (entries, m) packed matrices of `size` columns.
        size: columns of the packed matrices.
        leading_size: number of columns to factor.

    Returns:
        (p, p, m) L, a unit lower triangle below its diagonal, and (p, m) 1 / D.
    """
    m = G.shape[1]
    L = np.zeros((leading_size, leading_size, m))
    inverse = np.empty((leading_size, m))
    for i in range(leading_size):
        diagonal = G[find_packed_index(i, i, size)]
        pivot = inverse[i]
        for k in range(m):
            pivot[k] = diagonal[k]
        for j in range(i):
            entry = G[find_packed_index(j, i, size)]
            lower = L[i, j]
            for k in range(m):
                lower[k] = entry[k]
            for r in range(j):
                # above its diagonal L holds L D, which is subtracted
                a, b = L[j, r], L[r, i]
                for k in range(m):
                    lower[k] -= a[k] * b[k]
            scaled, d = L[j, i], inverse[j]
            for k in range(m):
                scaled[k] = lower[k]
                lower[k] *= d[k]
                pivot[k] -= lower[k] * scaled[k]
        for k in range(m):
            regular = pivot[k] > DEPENDENT * diagonal[k] and diagonal[k] > NOTHING
            pivot[k] = 1.0 / pivot[k] if regular else np.nan
    return L, inverse


def _solve_factored_vectorised(L: Floats, inverse: Floats, x: Floats) -> None:
    """Form of `substitute` by whole arrays."""
    p = len(inverse)
    for i in range(p):
        for r in range(i):
            x[i] -= L[i, r] * x[r]
    for i in range(p - 1, -1, -1):
        x[i] *= inverse[i]
        for r in range(i + 1, p):
            x[i] -= L[r, i] * x[r]


@compiled_with_array_form(_solve_factored_vectorised)
def solve_factored_in_place(L: Floats, inverse: Floats, x: Floats) -> None:
    """Solve m factored systems in place: x (p, m) is the right-hand side, then the solution."""
    p, m = inverse.shape
    for i in range(p):
        for r in range(i):
            out, lower, known = x[i], L[i, r], x[r]
            for k in range(m):
                out[k] -= lower[k] * known[k]
    for i in range(p - 1, -1, -1):
        out, d = x[i], inverse[i]
        for k in range(m):
            out[k] *= d[k]
        for r in range(i + 1, p):
            lower, known = L[r, i], x[r]
            for k in range(m):
                out[k] -= lower[k] * known[k]


def invert_factored_systems(L: Floats, inverse: Floats) -> Floats:
    """Inverses (p, p, m) of m factored systems."""
    p, m = inverse.shape
    out = np.zeros((p, p, m))
    for i in range(p):
        out[i, i] = 1.0
        solve_factored_in_place(L, inverse, out[i])
    return out


def _compute_condition_numbers_vectorised(G: Floats, size: int, p: int) -> Floats:
    i, j = np.triu_indices(p)
    rows = [find_packed_index(a, b, size) for a, b in zip(i.tolist(), j.tolist(), strict=True)]
    squares = np.array([G[find_packed_index(a, a, size)] for a in range(p)])
    N = G[rows] / np.sqrt(squares[i] * squares[j])
    for _ in range(_SWEEPS if p > 2 else 1):
        for a in range(p):
            for b in range(a + 1, p):
                _rotate_by_jacobi_in_place_vectorised(N, p, a, b, G.shape[1])
    values = N[[find_packed_index(a, a, p) for a in range(p)]]
    low, high = values[0], values[0]
    for value in values[1:]:
        low, high = np.where(value < low, value, low), np.where(value > high, value, high)
    out = np.where(low > 0.0, np.sqrt(high / low), np.inf)
    # a column of zeros
    return np.where(np.isnan(values).any(axis=0), np.inf, out)


@compiled_with_array_form(_compute_condition_numbers_vectorised)
def compute_condition_numbers(G: Floats, size: int, leading_size: int) -> Floats:
    """Condition numbers (m,) of A, columns scaled to unit norm, from m packed AᵀA.

    The eigenvalues are from Jacobi rotations; a 2 × 2 matrix needs one.

    Args:
        G: (entries, m) packed matrices of `size` columns.
        size: columns of the packed matrices.
        leading_size: number of leading columns to use.
    """
    m = G.shape[1]
    N = np.empty((leading_size * (leading_size + 1) // 2, m))
    for i in range(leading_size):
        for j in range(i, leading_size):
            entry, left, right = (
                G[find_packed_index(i, j, size)],
                G[find_packed_index(i, i, size)],
                G[find_packed_index(j, j, size)],
            )
            scaled = N[find_packed_index(i, j, leading_size)]
            for k in range(m):
                scaled[k] = entry[k] / np.sqrt(left[k] * right[k])
    for _ in range(_SWEEPS if leading_size > 2 else 1):
        for i in range(leading_size):
            for j in range(i + 1, leading_size):
                rotate_by_jacobi_in_place(N, leading_size, i, j, m)
    low = N[0].copy()
    high = N[0].copy()
    for i in range(1, leading_size):
        value = N[find_packed_index(i, i, leading_size)]
        for k in range(m):
            low[k] = value[k] if value[k] < low[k] else low[k]
            high[k] = value[k] if value[k] > high[k] else high[k]
    out = np.empty(m)
    for k in range(m):
        out[k] = np.sqrt(high[k] / low[k]) if low[k] > 0.0 else np.inf
    for i in range(leading_size):
        value = N[find_packed_index(i, i, leading_size)]
        for k in range(m):
            # a column of zeros
            out[k] = np.inf if np.isnan(value[k]) else out[k]
    return out


def _rotate_by_jacobi_in_place_vectorised(N: Floats, p: int, i: int, j: int, _m: int) -> None:
    a, b, c = (
        N[find_packed_index(i, i, p)],
        N[find_packed_index(j, j, p)],
        N[find_packed_index(i, j, p)],
    )
    double, gap = 2.0 * c, b - a
    root = np.abs(gap) + np.sqrt(gap * gap + double * double)
    tangent = np.where(root > 0.0, np.where(gap >= 0.0, double, -double) / root, 0.0)
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    a -= tangent * c
    b += tangent * c
    c[:] = np.where(np.isnan(root), c, 0.0)
    for r in set(range(p)) - {i, j}:
        x, y = (N[find_packed_index(min(r, k), max(r, k), p)] for k in (i, j))
        old = x.copy()
        x[:] = cosine * old - sine * y
        y[:] = sine * old + cosine * y


@compiled_with_array_form(_rotate_by_jacobi_in_place_vectorised)
def rotate_by_jacobi_in_place(N: Floats, p: int, i: int, j: int, m: int) -> None:
    """Apply the Jacobi rotation that makes entry (i, j) of m matrices 0."""
    a, b, c = (
        N[find_packed_index(i, i, p)],
        N[find_packed_index(j, j, p)],
        N[find_packed_index(i, j, p)],
    )
    sine = np.empty(m)
    cosine = np.empty(m)
    for k in range(m):
        double = 2.0 * c[k]
        gap = b[k] - a[k]
        # the smaller of the two angles; none where the entry is zero already
        root = abs(gap) + np.sqrt(gap * gap + double * double)
        tangent = (double if gap >= 0.0 else -double) / root if root > 0.0 else 0.0
        cosine[k] = 1.0 / np.sqrt(1.0 + tangent * tangent)
        sine[k] = tangent * cosine[k]
        a[k] -= tangent * c[k]
        b[k] += tangent * c[k]
        c[k] = c[k] if np.isnan(root) else 0.0
    for r in range(p):
        if r != i and r != j:
            x, y = (
                N[find_packed_index(min(r, i), max(r, i), p)],
                N[find_packed_index(min(r, j), max(r, j), p)],
            )
            for k in range(m):
                old = x[k]
                x[k] = cosine[k] * old - sine[k] * y[k]
                y[k] = sine[k] * old + cosine[k] * y[k]


@cache
def make_packed_index_table(size: int) -> tuple[tuple[int, ...], ...]:
    """Packed index of each entry (i, j) of a symmetric matrix of `size` columns, by i and j.

    On board they are needed many times per step; calling a compiled loop each time would be slow.
    """
    each = range(size)
    return tuple(tuple(find_packed_index(min(i, j), max(i, j), size) for j in each) for i in each)


@cache
def _list_upper_triangle_indices(size: int) -> tuple[Ints, Ints]:
    rows, columns = np.triu_indices(size)
    return rows, columns


def pack_symmetric_matrix(G: Floats) -> Floats:
    """Pack one symmetric matrix (size, size) into (entries,)."""
    return np.asarray(G[_list_upper_triangle_indices(len(G))], np.float64)


def unpack_leading_block(entries: Floats, size: int, p: int) -> Floats:
    """Leading (p, p) of one packed symmetric matrix of `size` columns."""
    return entries[[row[:p] for row in make_packed_index_table(size)[:p]]]


def solve_positive_definite(G: Floats, h: Floats) -> Floats:
    """Solution (p,) of one system G (p, p) x = h (p,); NaN if G is singular."""
    x = np.array(h, np.float64).reshape(-1, 1)
    solve_factored_in_place(
        *factor_packed_ldl(pack_symmetric_matrix(G).reshape(-1, 1), len(G), len(G)), x
    )
    return x[:, 0]


def invert_positive_definite(G: Floats) -> Floats:
    """Inverse of one symmetric positive definite matrix; NaN if it is singular."""
    return invert_factored_systems(
        *factor_packed_ldl(pack_symmetric_matrix(G).reshape(-1, 1), len(G), len(G))
    )[:, :, 0]


def compute_scaled_condition(G: Floats) -> float:
    """Condition number of A from its Gram matrix G = AᵀA, columns scaled to unit norm."""
    return float(
        compute_condition_numbers(pack_symmetric_matrix(G).reshape(-1, 1), len(G), len(G))[0]
    )


def make_noise_bound_in_each_direction(noise: Floats, gram: Floats, max_fraction: float) -> Floats:
    """Matrix K (p, p) with K N Kᵀ at most a fraction of G in every direction.

    Directions below the fraction keep their noise. K is the identity if all directions are below
    it, or if G is not positive definite.

    Args:
        noise: (p, p) N, positive semidefinite.
        gram: (p, p) G.
        max_fraction: the largest fraction.
    """
    try:
        root, whitened = _compute_gram_root_and_whitened_noise(noise, gram)
    except np.linalg.LinAlgError:
        return np.eye(len(gram))
    fractions, directions = np.linalg.eigh(whitened)
    if fractions[-1] <= max_fraction:
        return np.eye(len(gram))
    shrink = np.sqrt(max_fraction / np.maximum(fractions, max_fraction))
    bound = np.linalg.solve(root.T, ((root @ directions) * shrink @ directions.T).T).T
    return np.asarray(bound, np.float64)


def compute_largest_noise_fraction(noise: Floats, gram: Floats) -> float:
    """Largest fraction of noise in any direction of the columns."""
    if not noise.any():
        return 0.0
    try:
        _, whitened = _compute_gram_root_and_whitened_noise(noise, gram)
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.linalg.eigvalsh(whitened)[-1])


def _compute_gram_root_and_whitened_noise(noise: Floats, gram: Floats) -> tuple[Floats, Floats]:
    """Root L of G = L Lᵀ, and L⁻¹ N L⁻ᵀ.

    Raises:
        LinAlgError: G is not positive definite.
    """
    root = np.asarray(np.linalg.cholesky(gram), np.float64)
    half = np.linalg.solve(root, noise)
    return root, np.asarray(np.linalg.solve(root, half.T), np.float64)
