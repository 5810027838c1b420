"""Recursive least squares (12)-(15) with exponential forgetting.

Starts from the OLS estimate of the first accepted window with P₀ = I/σ², σ² the smallest variance
of the data matrix's columns that vary. The printed (13)-(14) mix A and its transpose; in one form,
a sample at a time: K = P a / (λ + aᵀ P a), P ← (P - K aᵀ P) / λ. Sliding windows share samples, so
each sample is fed once, over the union of the accepted windows.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from estimators.autocorrelation import pooled_autocorrelation
from estimators.linear import condition_number, inverse_spd, lstsq
from estimators.ls import solve_windows, window_residuals
from estimators.rolling import window_ends
from estimators.sandwich import meat
from estimators.trace import Bools, Floats, Ints, Trace


@dataclass(frozen=True, slots=True)
class RlsOptions:
    """How the past is forgotten.

    Attributes:
        forgetting: λ, by which the weight of a sample falls with each one that follows.
        directional: forget only along the new sample's direction (Bittanti, Bolzern, Campi 1990),
            so that a long cruise does not blow P up along the acceleration.
    """

    forgetting: float = 0.998
    directional: bool = False


@dataclass(frozen=True, slots=True)
class RlsState:
    """All that the recursion keeps.

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
    """Begin from the OLS estimate of a first window.

    Args:
        A: (n, p) regressor of the window.
        f: (n,) force.
        options: the forgetting, which does not matter here.
    """
    del options
    theta = lstsq(A, f)
    residual = f - A @ theta
    variances = A.var(axis=0)
    # a column that stays the same (Coulomb's sign while driving) would make P₀ infinite
    varying = variances[variances > 1e-12 * (A**2).mean(axis=0)]
    smallest = float(varying.min()) if varying.size else 1.0
    return RlsState(theta, np.eye(A.shape[1]) / smallest, float(residual @ residual), f.size)


def step(state: RlsState, a: Floats, f: float, options: RlsOptions | None = None) -> RlsState:
    """Feed one sample: a (p,) the regressor's row, f the force."""
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


@njit(cache=True)
def _learn(P: Floats, a: Floats, forgetting: float, directional: bool) -> Floats:
    """The gain of a sample; P is updated in place."""
    p = a.size
    Pa = np.zeros(p)
    r = 0.0
    for i in range(p):
        for c in range(p):
            Pa[i] += P[i, c] * a[c]
        r += a[i] * Pa[i]
    if directional:
        beta = forgetting - (1.0 - forgetting) / r if r > 0.0 else 0.0
        shrink = beta / (1.0 + beta * r)
        grow = 1.0
        gain = Pa / (1.0 + r)
    else:
        shrink = 1.0 / (forgetting + r)
        grow = 1.0 / forgetting
        gain = Pa / (forgetting + r)
    for i in range(p):
        for c in range(i + 1):
            P[i, c] = (P[i, c] - shrink * Pa[i] * Pa[c]) * grow
            P[c, i] = P[i, c]
    return gain


@njit(cache=True)
def _feed(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    options: tuple[float, bool],
    theta: Floats,
    P: Floats,
    sums: tuple[float, float],
) -> tuple[Floats, Floats, Floats]:
    """Steps over the union of the windows in index; θ, r.m.s. and condition of P⁻¹."""
    rows = index.size
    p = theta.size
    forgetting, directional = options
    square, weight = sums
    out = np.empty((rows, p))
    rms = np.empty(rows)
    condition = np.empty(rows)
    theta = theta.copy()
    P = P.copy()
    for row in range(rows):
        first = max(index[row - 1] + 1, index[row] - window + 1) if row else index[0] + 1
        for k in range(first, index[row] + 1):
            error = f[k]
            for c in range(p):
                error -= A[k, c] * theta[c]
            gain = _learn(P, A[k], forgetting, directional)
            after = f[k]
            for c in range(p):
                theta[c] += gain[c] * error
                after -= A[k, c] * theta[c]
            square = forgetting * square + error * after
            weight = forgetting * weight + 1.0
        out[row] = theta
        rms[row] = np.sqrt(max(square, 0.0) / weight)
        condition[row] = condition_number(inverse_spd(P))
    return out, rms, condition


@njit(cache=True)
def _deviations(
    A: Floats,
    window: int,
    index: Ints,
    options: tuple[float, bool],
    P: Floats,
    cover: Floats,
    ahead: Floats,
    correlation: Floats,
) -> Floats:
    """Standard deviations for residuals of variance 1, by the recursion's own error equation.

    With F = I - K aᵀ the error obeys e ← F e + K u. Its covariance needs what e shares with the
    residual that comes next, which the correlation of the residuals carries along:
    `ahead[j]` = cov(e, u of the sample j + 1 ahead).

    Args:
        A: (n, p) regressor.
        window: samples in a window.
        index: (rows,) last samples of the accepted windows.
        options: forgetting, directional.
        P: (p, p) at the end of the first window.
        cover: (p, p) covariance of the first estimate.
        ahead: (lags, p) its covariance with the residuals that follow.
        correlation: (lags,) residual autocorrelation, 1 first.
    """
    rows = index.size
    p = A.shape[1]
    forgetting, directional = options
    lags = correlation.size
    P = P.copy()
    S = cover.copy()
    C = ahead.copy()
    F = np.empty((p, p))
    half = np.empty((p, p))
    share = np.empty(p)
    moved = np.empty(p)
    std = np.empty((rows, p))
    last = index[0]
    for row in range(rows):
        first = max(index[row - 1] + 1, index[row] - window + 1) if row else index[0] + 1
        for k in range(first, index[row] + 1):
            gap = k - last - 1
            last = k
            gain = _learn(P, A[k], forgetting, directional)
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
                # ascending, so that what is read has not been moved yet
                for i in range(p):
                    moved[i] = gain[i] * correlation[j + 1] if j + 1 < lags else 0.0
                    if j + 1 + gap < lags:
                        for c in range(p):
                            moved[i] += F[i, c] * C[j + 1 + gap, c]
                for i in range(p):
                    C[j, i] = moved[i]
        for i in range(p):
            std[row, i] = np.sqrt(max(S[i, i], 0.0))
    return std


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: RlsOptions | None = None
) -> Trace:
    """Run the recursion over the union of the accepted windows; equals repeated `step`.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: the forgetting.

    Returns:
        A row an accepted window, the state after its last sample. The first row is the OLS
        estimate of the first window.
    """
    options = options or RlsOptions()
    index = window_ends(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    first = slice(index[0] - window + 1, index[0] + 1)
    begin = start(A[first], f[first], options)
    how = (options.forgetting, options.directional)
    theta, rms, condition = _feed(
        A, f, window, index, how, begin.theta, begin.P, (begin.square, begin.weight)
    )
    # of windows fitted by themselves: what the recursion takes out of its own is not known
    least, _, _, _ = solve_windows(A, f, window, index)
    correlation, variance = pooled_autocorrelation(*window_residuals(A, f, least, index, window), A)
    gram = A[first].T @ A[first]
    bread: Floats = np.asarray(np.linalg.pinv(gram), np.float64)
    B = meat(A[first], np.zeros(window, np.int64), 0, 0, window - 1, correlation)
    cover: Floats = np.asarray(bread @ B @ bread, np.float64)
    ahead = np.zeros((correlation.size, p))
    for j in range(correlation.size - 1):
        # the first window's samples that the residual j + 1 after it still knows
        near = correlation[j + 1 :][:window]
        ahead[j] = bread @ (near @ A[first][::-1][: near.size])
    std = _deviations(A, window, index, how, begin.P, cover, ahead, correlation)
    # a tapered correlation need not be positive definite: never below uncorrelated residuals
    none = np.zeros((1, p))
    white = _deviations(A, window, index, how, begin.P, bread, none, np.ones(1))
    std = np.maximum(std, white) * np.sqrt(variance)
    condition[0] = condition_number(gram)
    return Trace(index, theta, std, rms, condition, correlation)
