"""Mean of overlapping windows' estimates, with a standard deviation that allows for overlap.

Windows weigh by what they know of the first parameter, ω_w ∝ 1/std². The mean
θ̄ = Σ_w ω_w G_w⁻¹ Σ_{k∈w} a_k f_k
is linear in the force: sample k enters with c_k = (Σ_{w∋k} ω_w G_w⁻¹) a_k. So cov θ̄ = s² Cᵀ R C,
whatever the overlap.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_ahead
from estimators.methods.ls import solve_windows
from estimators.numerics.autocorrelation import (
    pooled_autocorrelation,
    residuals_of_disjoint_windows,
)
from estimators.numerics.sandwich import meat
from estimators.numerics.small_systems import factor, invert


@compiled_ahead
def mean_weights(A: Floats, breads: Floats, index: Ints, window: int) -> tuple[Floats, Ints]:
    """Weights c_k (n, p), and 0 for samples inside an accepted window, -1 for others, (n,).

    Breads (p, p, rows) are the windows' ω G⁻¹.
    """
    n, p = A.shape
    cover = np.zeros((p, p))
    weights = np.zeros((n, p))
    inside = np.full(n, -1, np.int64)
    begun = ended = 0
    for k in range(n):
        while begun < index.size and index[begun] - window + 1 <= k:
            for i in range(p):
                for j in range(p):
                    cover[i, j] += breads[i, j, begun]
            begun += 1
        while ended < begun and index[ended] < k:
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
            # outside every window the cover is zero: drop what rounding has left
            for i in range(p):
                for j in range(p):
                    cover[i, j] = 0.0
    return weights, inside


def mean_estimate(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    theta: Floats,
    std: Floats,
    systematic: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Weighted mean of θ over all rows of a windowed trace, with its standard deviation.

    It is exact for LS, and of first order for FGLS and TLS, by the LS weights.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        window: samples in a window.
        index: (rows,) last sample of each window, ascending.
        theta: (rows, p) estimates of the windows.
        std: (rows, p) standard deviations of the estimates.
        systematic: (rows, p) errors of one sign in all windows that the residuals do not show and
            that no mean reduces; None for none.

    Returns:
        (p,) mean and (p,) standard deviations, NaN if no window has an estimate.
    """
    solved = np.isfinite(theta[:, 0]) & np.isfinite(std[:, 0])
    if not solved.any():
        return np.full(A.shape[1], np.nan), np.full(A.shape[1], np.nan)
    index, theta, std = index[solved], theta[solved], std[solved]
    least = solve_windows(A, f, window, index)
    grams = np.ascontiguousarray(least.grams.T)
    known = np.maximum(std[:, 0], np.finfo(float).tiny ** 0.25)
    share = known**-2.0 / (known**-2.0).sum()
    breads = invert(*factor(grams, A.shape[1], A.shape[1])) * share
    weights, inside = mean_weights(A, breads, index, window)
    # the residuals' own correlation, which a window where TLS is wild would hide
    residual, owner = residuals_of_disjoint_windows(A, f, least.theta, index, window)
    correlation, variance = pooled_autocorrelation(residual, owner, A)
    cover = meat(weights, inside, 0, 0, f.size - 1, correlation)
    white = meat(weights, inside, 0, 0, f.size - 1, np.ones(1))
    deviation = np.sqrt(np.maximum(np.diag(cover), np.diag(white)) * variance)
    if systematic is not None:
        deviation = np.hypot(deviation, share @ systematic[solved])
    return share @ theta, deviation
