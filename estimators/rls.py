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
from estimators.rolling import window_ends
from estimators.sandwich import meat
from estimators.trace import Bools, Floats, Ints, Trace


@dataclass(frozen=True, slots=True)
class RlsOptions:
    """λ: the weight of a sample falls by this factor with each one that follows."""

    forgetting: float = 0.998


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
    forgetting = (options or RlsOptions()).forgetting
    error = f - a @ state.theta
    Pa = state.P @ a
    gain = Pa / (forgetting + a @ Pa)
    theta = state.theta + gain * error
    P = (state.P - np.outer(gain, Pa)) / forgetting
    after = f - a @ theta
    return RlsState(
        theta,
        (P + P.T) / 2.0,
        forgetting * state.square + float(error * after),
        forgetting * state.weight + 1.0,
    )


@njit(cache=True)
def _feed(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    forgetting: float,
    theta: Floats,
    P: Floats,
    square: float,
    weight: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Steps over the union of the windows in index; the state at each of them, and residuals."""
    rows = index.size
    p = theta.size
    out = np.empty((rows, p))
    factors = np.empty((rows, p, p))
    rms = np.empty(rows)
    residual = np.full(f.size, np.nan)
    theta = theta.copy()
    P = P.copy()
    out[0] = theta
    factors[0] = P
    rms[0] = np.sqrt(square / weight)
    for row in range(1, rows):
        first = max(index[row - 1] + 1, index[row] - window + 1)
        for k in range(first, index[row] + 1):
            error = f[k]
            for c in range(p):
                error -= A[k, c] * theta[c]
            Pa = P @ A[k]
            gain = Pa / (forgetting + A[k] @ Pa)
            after = f[k]
            for c in range(p):
                theta[c] += gain[c] * error
                after -= A[k, c] * theta[c]
            for i in range(p):
                for c in range(i + 1):
                    value = 0.5 * (gain[i] * Pa[c] + gain[c] * Pa[i])
                    P[i, c] = (P[i, c] - value) / forgetting
                    P[c, i] = P[i, c]
            square = forgetting * square + error * after
            weight = forgetting * weight + 1.0
            residual[k] = after
        out[row] = theta
        factors[row] = P
        rms[row] = np.sqrt(max(square, 0.0) / weight)
    return out, factors, rms, residual


@njit(cache=True)
def _deviations(
    A: Floats,
    window: int,
    index: Ints,
    forgetting: float,
    factors: Floats,
    B: Floats,
    fed: Bools,
    correlation: Floats,
    variance: float,
) -> tuple[Floats, Floats]:
    """Sandwich P B P s² with B discounted by λ² a sample; and the condition of P⁻¹.

    Never smaller than with uncorrelated residuals: a tapered correlation need not be positive
    definite.
    """
    rows = index.size
    p = A.shape[1]
    std = np.empty((rows, p))
    condition = np.empty(rows)
    tail = np.empty(p)
    white = B.copy()
    for row in range(rows):
        first = index[row] + 1 if row == 0 else max(index[row - 1] + 1, index[row] - window + 1)
        for k in range(first, index[row] + 1):
            tail[:] = 0.5 * A[k]
            discount = 1.0
            for j in range(1, min(correlation.size, k + 1)):
                discount *= forgetting
                if fed[k - j]:
                    for c in range(p):
                        tail[c] += correlation[j] * discount * A[k - j, c]
            for i in range(p):
                for c in range(p):
                    B[i, c] *= forgetting * forgetting
                    B[i, c] += A[k, i] * tail[c] + tail[i] * A[k, c]
                    white[i, c] *= forgetting * forgetting
                    white[i, c] += A[k, i] * A[k, c]
        cover = factors[row] @ B @ factors[row]
        floor = factors[row] @ white @ factors[row]
        for i in range(p):
            std[row, i] = np.sqrt(max(cover[i, i], floor[i, i]) * variance)
        condition[row] = condition_number(inverse_spd(factors[row]))
    return std, condition


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
    theta, factors, rms, residual = _feed(
        A, f, window, index, options.forgetting, begin.theta, begin.P, begin.square, begin.weight
    )
    residual[first] = f[first] - A[first] @ begin.theta
    fed = np.isfinite(residual)
    # the recursion's memory is long: its residuals carry no window's fit to correct for
    correlation, variance = pooled_autocorrelation(residual, np.where(fed, 0, -1), 0)
    # θ₀ enters the recursion with the weight P₀⁻¹, as if it were a sample
    gram = A[first].T @ A[first]
    bread = np.linalg.pinv(gram) @ np.linalg.inv(begin.P)
    group = np.zeros(window, np.int64)
    B = bread.T @ meat(A[first], group, 0, 0, window - 1, correlation) @ bread
    std, condition = _deviations(
        A, window, index, options.forgetting, factors, B, fed, correlation, variance
    )
    condition[0] = condition_number(gram)
    return Trace(index, theta, std, rms, condition, correlation)
