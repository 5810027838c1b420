"""Forgetting along the new sample's direction alone (Bittanti, Bolzern, Campi 1990).

Since forgetting depends on the covariance, no discounted sum can be solved: the recursion runs in
its covariance form, and the covariance of its error follows from the equation of the error.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log


@compiled_unless_short_log
def compute_gain_and_update_p_in_place(P: Floats, a: Floats, forgetting: float) -> Floats:
    """Gain K (p,) of one sample a (p,); P is updated in place."""
    p = a.size
    Pa = np.zeros(p)
    r = 0.0
    for i in range(p):
        for c in range(p):
            Pa[i] += P[i, c] * a[c]
        r += a[i] * Pa[i]
    beta = forgetting - (1.0 - forgetting) / r if r > 0.0 else 0.0
    shrink = beta / (1.0 + beta * r)
    for i in range(p):
        for c in range(i + 1):
            P[i, c] -= shrink * Pa[i] * Pa[c]
            P[c, i] = P[i, c]
    return Pa / (1.0 + r)


@compiled_unless_short_log
def run_recursion_over_windows(
    A: Floats,
    f: Floats,
    window: int,
    window_ends: Ints,
    forgetting: float,
    theta: Floats,
    P: Floats,
    sums: tuple[float, float],
) -> tuple[Floats, Floats, Floats, tuple[float, float]]:
    """Run the recursion over the union of the windows in `window_ends`.

    Returns:
        θ, r.m.s. and P of each row, and the final sums.
    """
    rows = window_ends.size
    p = theta.size
    square, weight = sums
    out = np.empty((rows, p))
    rms = np.empty(rows)
    covariance = np.empty((rows, p, p))
    theta = theta.copy()
    P = P.copy()
    for row in range(rows):
        first = (
            max(window_ends[row - 1] + 1, window_ends[row] - window + 1)
            if row
            else window_ends[0] + 1
        )
        for k in range(first, window_ends[row] + 1):
            error = f[k]
            for c in range(p):
                error -= A[k, c] * theta[c]
            gain = compute_gain_and_update_p_in_place(P, A[k], forgetting)
            after = f[k]
            for c in range(p):
                theta[c] += gain[c] * error
                after -= A[k, c] * theta[c]
            square = forgetting * square + error * after
            weight = forgetting * weight + 1.0
        out[row] = theta
        rms[row] = np.sqrt(max(square, 0.0) / weight)
        covariance[row] = P
    return out, rms, covariance, (square, weight)


@compiled_unless_short_log
def compute_recursive_estimate_stds(
    A: Floats,
    window_samples: int,
    window_ends: Ints,
    forgetting: float,
    covariance_factor: Floats,
    first_covariance: Floats,
    first_lag_covariances: Floats,
    residual_autocorrelation: Floats,
) -> Floats:
    """Standard deviations for residuals of variance 1, from the recursion's error equation.

    With F = I - K aᵀ the error obeys e ← F e + K u. Its covariance requires the covariance of e
    with the next residuals, which are correlated with the past ones: `first_lag_covariances[j]` =
    cov(e, u of the sample j + 1 ahead).

    Args:
        A: (n, p) regressor.
        window_samples: samples in a window.
        window_ends: (rows,) last samples of the accepted windows.
        forgetting: λ.
        covariance_factor: (p, p) covariance factor at the end of the first window.
        first_covariance: (p, p) covariance of the first estimate.
        first_lag_covariances: (lags, p) covariance of that estimate with the following residuals.
        residual_autocorrelation: (lags,) residual autocorrelation, 1 first.
    """
    rows = window_ends.size
    p = A.shape[1]
    lags = residual_autocorrelation.size
    covariance_factor = covariance_factor.copy()
    S = first_covariance.copy()
    C = first_lag_covariances.copy()
    F = np.empty((p, p))
    half = np.empty((p, p))
    share = np.empty(p)
    moved = np.empty(p)
    std = np.empty((rows, p))
    last = window_ends[0]
    for row in range(rows):
        first = (
            max(window_ends[row - 1] + 1, window_ends[row] - window_samples + 1)
            if row
            else window_ends[0] + 1
        )
        for k in range(first, window_ends[row] + 1):
            gap = k - last - 1
            last = k
            gain = compute_gain_and_update_p_in_place(covariance_factor, A[k], forgetting)
            for i in range(p):
                for c in range(p):
                    F[i, c] = (1.0 if i == c else 0.0) - gain[i] * A[k, c]
            for i in range(p):
                share[i] = 0.0
                for c in range(p):
                    half[i, c] = 0.0
                    for d in range(p):
                        half[i, c] += F[i, d] * S[d, c]
                    if gap < lags:
                        share[i] += F[i, c] * C[gap, c]
            for i in range(p):
                for c in range(p):
                    S[i, c] = share[i] * gain[c] + gain[i] * share[c] + gain[i] * gain[c]
                    for d in range(p):
                        S[i, c] += half[i, d] * F[c, d]
            for j in range(lags):
                # ascending, so that elements are read before they are overwritten
                for i in range(p):
                    moved[i] = gain[i] * residual_autocorrelation[j + 1] if j + 1 < lags else 0.0
                    if j + 1 + gap < lags:
                        for c in range(p):
                            moved[i] += F[i, c] * C[j + 1 + gap, c]
                for i in range(p):
                    C[j, i] = moved[i]
        for i in range(p):
            std[row, i] = np.sqrt(max(S[i, i], 0.0))
    return std
