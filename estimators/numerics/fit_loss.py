"""Loss of autocovariance of residuals caused by a least-squares fit.

The residuals are e = M u with M = I - QQᵀ, Q an orthonormal basis of the regressor. With u's
autocovariances r, E Σ_i e_i e_{i+j} = Σ_l r_l tr(D_j M R_l M), R_l with ones at the distances ±l
and D_j with halves at ±j: this is linear in r, which can thus be recovered. To first order every
lag loses p/n of the long-run variance, and less if the correlation lasts as long as the regressor
takes to change.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.in_order import multiply_vectors, sum_axis_in_order
from estimators.numerics.numerics_limits import LIMITS

#: Number of lags whose sums are accumulated side by side, each in its own order.
_AT_ONCE = 128


def _sum_basis_products_vectorised(Q: Floats, lag_count: int) -> Floats:
    n, p = Q.shape
    columns = np.zeros((p, n + lag_count))
    columns[:, :n] = Q.T
    cross = np.zeros((p, p, lag_count))
    for k in range(n):
        cross += columns[:, k, None, None] * columns[:, k : k + lag_count]
    return cross


@compiled_with_array_form(_sum_basis_products_vectorised)
def sum_basis_products_by_lag(Q: Floats, lag_count: int) -> Floats:
    """Σ_k Q_ki Q_(k+d)c of Q (n, p) for lags d < `lag_count`, as (p, p, lags)."""
    n, p = Q.shape
    # zeros behind the end, so that all distances have as many terms
    columns = np.zeros((p, n + lag_count + 4))
    for i in range(p):
        for k in range(n):
            columns[i, k] = Q[k, i]
    cross = np.zeros((p, p, lag_count))
    for first in range(0, min(lag_count, n), _AT_ONCE):
        width = min(_AT_ONCE, lag_count - first)
        for i in range(p):
            for c in range(p):
                sums = cross[i, c, first : first + width]
                # four terms per iteration, added in order, so that sums are loaded less often
                for k in range(0, n - first, 4):
                    q, r, s, t = columns[i, k : k + 4]
                    others = columns[c, k + first : k + first + width + 3]
                    for d in range(np.uint64(width)):
                        total = sums[d] + q * others[d]
                        total += r * others[d + np.uint64(1)]
                        total += s * others[d + np.uint64(2)]
                        sums[d] = total + t * others[d + np.uint64(3)]
    return cross


def add_autocovariance_loss_of_fit_in_place_vectorised(Q: Floats, loss: Floats) -> None:
    """Add the loss (lags, lags) of a fit with orthonormal basis Q (n, p), without loops over n."""
    n, p = Q.shape
    lags = len(loss)
    cross = _sum_basis_products_vectorised(Q, 2 * lags - 1)
    both = (cross[:, :, :lags] + cross[:, :, :lags].transpose(1, 0, 2)).reshape(p * p, lags)
    alike = cross[np.arange(p), np.arange(p)]
    pushed = np.zeros(lags)
    for j in range(lags):
        left = lags - j
        if 0 < j <= n:
            reach = min(left, n - j + 1)
            after, before = Q[j - 1 : j - 1 + reach], Q[n - j - reach + 1 : n - j + 1][::-1]
            for i in range(p):
                pushed[:reach] += Q[j - 1, i] * after[:, i]
                pushed[:reach] += before[:, i] * Q[n - j, i]
        shifted = -pushed[:left]
        for near in alike:
            shifted += 2.0 * (near[:left] + near[2 * j : j + lags])
        inside = sum_axis_in_order(both[:, j, None] * both[:, j:], 0)
        more = shifted - 0.5 * inside
        loss[j, j] += (0.5 if j == 0 else 1.0) * more[0]
        loss[j, j + 1 :] += more[1:]
        loss[j + 1 :, j] += (0.5 if j == 0 else 1.0) * more[1:]


@compiled_with_array_form(add_autocovariance_loss_of_fit_in_place_vectorised)
def add_autocovariance_loss_of_fit_in_place(Q: Floats, loss: Floats) -> None:
    """Add one fit's tr(D_j R_l) - tr(D_j M R_l M) to loss (lags, lags); Q is (n, p).

    With S_j the sum of the shifts by ±j (D_j = S_j / 2), this is tr(Qᵀ S_j S_l Q) minus half of
    tr(Qᵀ S_j Q Qᵀ S_l Q): sums of products of Q with itself at a lag, minus the pairs that the
    shifts move beyond its ends.
    """
    n, p = Q.shape
    lags = loss.shape[0]
    cross = sum_basis_products_by_lag(Q, 2 * lags - 1)
    both = cross[:, :, :lags] + cross[:, :, :lags].transpose(1, 0, 2)
    columns = np.ascontiguousarray(Q.T)
    reversed_columns = np.ascontiguousarray(Q.T[:, ::-1])
    # of the distances d < lags - j
    pushed = np.zeros(lags)
    shifted, inside = np.empty(lags), np.empty(lags)
    for j in range(lags):
        # symmetric in j and l except for S_0, which is twice R_0
        left = lags - j
        if 0 < j <= n:
            for i in range(p):
                first, last = columns[i, j - 1], columns[i, n - j]
                after, before = columns[i, j - 1 :], reversed_columns[i, j - 1 :]
                for d in range(min(left, n - j + 1)):
                    pushed[d] += first * after[d]
                    pushed[d] += before[d] * last
        for d in range(left):
            shifted[d] = -pushed[d]
            inside[d] = 0.0
        for i in range(p):
            near, far = cross[i, i, :left], cross[i, i, 2 * j : j + lags]
            for d in range(left):
                shifted[d] += 2.0 * (near[d] + far[d])
            for c in range(p):
                at_j, at_l = both[i, c, j], both[i, c, j:]
                for d in range(left):
                    inside[d] += at_j * at_l[d]
        for d in range(left):
            more = shifted[d] - 0.5 * inside[d]
            loss[j, j + d] += (0.5 if j + d == 0 else 1.0) * more
            if d > 0:
                loss[j + d, j] += (0.5 if j == 0 else 1.0) * more


@compiled_unless_short_log
def make_orthonormal_basis(A: Floats) -> Floats:
    """Orthonormal basis of the columns of A (n, p), without dependent columns."""
    n, p = A.shape
    Q = np.zeros((n, p))
    q, other = np.empty(n), np.empty(n)
    for i in range(p):
        for k in range(n):
            q[k] = A[k, i]
        size = np.sqrt(multiply_vectors(q, q))
        # twice is enough (Giraud, Langou, Rozložník 2005)
        for _ in range(2):
            for c in range(i):
                for k in range(n):
                    other[k] = Q[k, c]
                along = multiply_vectors(other, q)
                for k in range(n):
                    q[k] -= along * other[k]
        left = np.sqrt(multiply_vectors(q, q))
        if left > 1e-7 * size:
            for k in range(n):
                Q[k, i] = q[k] / left
    return Q


def find_first_and_last_sample_of_groups(group: Ints, group_numbers: Ints) -> Ints:
    """First and last sample of each of `group_numbers` (ascending), (fits, 2)."""
    fit = np.minimum(np.searchsorted(group_numbers, group), group_numbers.size - 1)
    inside = np.flatnonzero(group_numbers[fit] == group)
    spans = np.empty((group_numbers.size, 2), np.int64)
    # if an element is assigned several times, the last value remains
    spans[fit[inside[::-1]], 0] = inside[::-1]
    spans[fit[inside], 1] = inside
    return spans


def _sum_autocovariance_loss_vectorised(A: Floats, group: Ints, spans: Ints, lags: int) -> Floats:
    loss, pairs = np.zeros((lags, lags)), np.zeros(lags)
    for first, last in spans.tolist():
        mine = group[first : last + 1] == group[first]
        for j in range(min(lags, mine.size)):
            pairs[j] += np.count_nonzero(mine[: mine.size - j] & mine[j:])
        add_autocovariance_loss_of_fit_in_place(
            make_orthonormal_basis(np.where(mine[:, None], A[first : last + 1], 0.0)), loss
        )
    return loss / np.maximum(pairs, 1.0)[:, None]


@compiled_with_array_form(_sum_autocovariance_loss_vectorised)
def sum_autocovariance_loss(A: Floats, group: Ints, spans: Ints, lags: int) -> Floats:
    """Loss (lags, lags) summed over the fits in `spans`, per pair of samples at each lag."""
    p = A.shape[1]
    loss = np.zeros((lags, lags))
    pairs = np.zeros(lags)
    for fit in range(spans.shape[0]):
        first, n = spans[fit, 0], spans[fit, 1] - spans[fit, 0] + 1
        B = np.zeros((n, p))
        for k in range(n):
            if group[first + k] == group[first]:
                for c in range(p):
                    B[k, c] = A[first + k, c]
                others = group[first + k : first + min(k + lags, n)]
                for j in range(np.uint64(others.size)):
                    pairs[j] += 1.0 if others[j] == group[first] else 0.0
        add_autocovariance_loss_of_fit_in_place(make_orthonormal_basis(B), loss)
    for j in range(lags):
        for m in range(lags):
            loss[j, m] /= max(pairs[j], 1.0)
    return loss


def list_group_numbers(group: Ints) -> Ints:
    """Numbers of the groups (fits, windows, segments) that occur, ascending.

    Args:
        group: (n,) group of each sample, negative for none.
    """
    used = group[group >= 0]
    steps = np.diff(used)
    # they mostly follow one another, and then need not be sorted
    if (steps < 0).any():
        return np.unique(used)
    return used[np.append(True, steps > 0)] if used.size else used


def list_rows_by_group(group: Ints) -> list[Ints]:
    """Samples of each group, in the order of `list_group_numbers`.

    Args:
        group: (n,) group of each sample, negative for none.
    """
    rows = np.flatnonzero(group >= 0)
    of = group[rows]
    # they mostly follow one another, and then need not be sorted
    if (np.diff(of) < 0).any():
        order = np.argsort(of, kind="stable")
        rows, of = rows[order], of[order]
    ends = np.flatnonzero(np.diff(of)) + 1
    return list(np.split(rows, ends)) if rows.size else []


def compute_fit_loss(A: Floats, group: Ints, lags: int) -> Floats:
    """Loss of the residuals' autocovariance at each lag, (lags, lags).

    Args:
        A: (n, p) regressor, fitted to each group separately.
        group: (n,) fit that each sample belongs to, negative for none.
        lags: number of lags, including lag 0.

    Returns:
        B with E[mean e_i e_{i+j}] = r_j - Σ_l B_jl r_l.
    """
    ids = list_group_numbers(group)
    if A.shape[1] * lags * ids.size < 0.005 * np.count_nonzero(group >= 0):
        return np.zeros((lags, lags))
    some = ids[np.linspace(0, ids.size - 1, min(ids.size, LIMITS.sampled_fits)).astype(np.int64)]
    return sum_autocovariance_loss(
        A, group, find_first_and_last_sample_of_groups(group, some), lags
    )
