"""What noise in a regressor's columns draws least squares towards zero by (errors in variables).

Noise of r.m.s. σ_c in column c adds N = n·diag(σ²) to AᵀA and nothing to Aᵀf, so that least squares
finds θ with AᵀA θ = (AᵀA - N) θ₀ (Fuller, Measurement Error Models, 1987). From what it found,
θ₀ = θ + (AᵀA - N)⁻¹ N θ. That difference is added by the methods that correct (and half of it
counted as uncertainty, since σ² is known to half of itself at best) and counted whole as
uncertainty by those that do not.
"""

import numpy as np

from estimators.compiled import compiled
from estimators.linear import at, solve_spd
from estimators.ls import solve_windows
from estimators.trace import Floats, Ints

#: The share of a correction that is uncertain.
DOUBT = 0.5


@compiled
def attenuation(G: Floats, theta: Floats, added: Floats) -> Floats:
    """(AᵀA - N)⁻¹ N θ, column by column of the noise.

    Args:
        G: (p, p) AᵀA as measured.
        theta: (p,) its least-squares solution.
        added: (p,) the diagonal of N.

    Returns:
        (p, p): row i holds what the noise of each column draws θ_i by; their sum is to be added.
        NaN where the columns are no more than their noise.
    """
    clean = G - np.diag(added)
    drawn = np.empty((theta.size, theta.size))
    one = np.zeros(theta.size)
    for c in range(theta.size):
        one[c] = added[c] * theta[c]
        drawn[:, c] = solve_spd(clean, one)
        one[c] = 0.0
    return drawn


@compiled
def attenuations(grams: Floats, samples: Floats, theta: Floats, noise_A: Floats) -> Floats:
    """(rows, p) what to add to each of several estimates.

    Args:
        grams: (rows, p, p) AᵀA as measured.
        samples: (rows,) samples in each.
        theta: (rows, p) their least-squares solutions.
        noise_A: (p,) r.m.s. noise of each column as it is in A.
    """
    out = np.empty(theta.shape)
    for row in range(samples.size):
        out[row] = attenuation(grams[row], theta[row], samples[row] * noise_A**2).sum(axis=1)
    return out


def window_attenuations(
    A: Floats, f: Floats, window: int, index: Ints, theta: Floats, noise_A: Floats
) -> Floats:
    """(rows, p) what to add to the estimates of the windows that end at `index`.

    To first order for weighted and recursive estimates, by the plain products of the window.
    """
    _, packed, _, _ = solve_windows(A, f, window, index)
    p = A.shape[1]
    grams = np.empty((index.size, p, p))
    for i in range(p):
        for j in range(i, p):
            grams[:, i, j] = grams[:, j, i] = packed[:, at(i, j, p)]
    return attenuations(grams, np.full(index.size, float(window)), theta, noise_A)
