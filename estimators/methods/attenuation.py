"""Attenuation of least squares by noise in the regressor's columns (errors in variables).

Noise of r.m.s. σ_c in column c adds N = n·diag(σ²) to AᵀA and nothing to Aᵀf, so that least squares
finds θ with AᵀA θ = (AᵀA - N) θ₀ (Fuller, Measurement Error Models, 1987). The true parameters are
θ₀ = θ + (AᵀA - N)⁻¹ N θ. Methods that correct for attenuation add this difference, and half of it
counts as uncertainty, since σ² is known to half of its value at best; for the others all of it
counts as uncertainty. If columns share noise, like a speed and its derivative, N is n times their
covariance; noise shared with f is subtracted from Aᵀf in the same way.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.methods.ls import solve_windows
from estimators.numerics.small_systems import (
    factor_packed_ldl,
    find_packed_index,
    invert_positive_definite,
    solve_factored_in_place,
)


def compute_attenuation_by_noise_source(
    G: Floats, theta: Floats, added_noise: Floats, noise_mixing: Floats | None = None
) -> Floats:
    """Attenuation (AᵀA - N)⁻¹ N θ of each parameter, by noise source.

    Args:
        G: (p, p) AᵀA as measured.
        theta: (p,) least-squares solution.
        added_noise: (s,) n·σ² of each source.
        noise_mixing: (p, s) loading of each column on each source, N = L diag(added) Lᵀ; None means
            that each column has its own source.

    Returns:
        (p, s) attenuation of θ_i by each source; their sum is to be added. NaN if the columns are
        only noise.
    """
    L = np.eye(theta.size) if noise_mixing is None else noise_mixing
    return invert_positive_definite(G - L * added_noise @ L.T) @ (L * (added_noise * (L.T @ theta)))


def compute_attenuation_corrections_of_windows(
    A: Floats, f: Floats, window: int, window_ends: Ints, theta: Floats, noise: Floats
) -> Floats:
    """Correction for attenuation of each window that ends at `window_ends`, (rows, p).

    For weighted and recursive estimates it is a first-order correction, from unweighted products.

    Args:
        A: (n, p) regressor.
        f: (n,) force or torque.
        window: samples in a window.
        window_ends: (rows,) last samples of the windows.
        theta: (rows, p) estimates of the windows.
        noise: (p + 1, p + 1) covariance of the noise in a row of [A f].
    """
    p = A.shape[1]
    added = window * noise
    clean = solve_windows(A, f, window, window_ends).grams.T.copy()
    for i in range(p):
        for j in range(i, p):
            clean[find_packed_index(i, j, p)] -= added[i, j]
    drawn = np.ascontiguousarray(added[:p, :p] @ theta.T - added[:p, p:])
    solve_factored_in_place(*factor_packed_ldl(clean, p, p), drawn)
    return drawn.T
