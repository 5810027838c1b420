"""The information index (11) between acceleration and force over a sliding window."""

import numpy as np
from numba import njit

from estimators.trace import Floats


@njit(cache=True)
def _merge(m: Floats, n: int, other: Floats, k: int, out: Floats) -> None:
    """Merge centred moments of n and k samples (Chan, Golub, LeVeque 1983).

    A row of moments is mean x, mean y, Sxx, Syy, Sxy.
    """
    total = n + k
    dx = other[0] - m[0]
    dy = other[1] - m[1]
    w = n * k / total
    out[2] = m[2] + other[2] + dx * dx * w
    out[3] = m[3] + other[3] + dy * dy * w
    out[4] = m[4] + other[4] + dx * dy * w
    out[0] = m[0] + dx * k / total
    out[1] = m[1] + dy * k / total


@njit(cache=True)
def window_correlation(x: Floats, y: Floats, window: int) -> tuple[Floats, Floats]:
    """Pearson's ρ of x and y over every run of exactly `window` samples.

    Centred moments are merged from two scans (see `estimators.rolling`), so that neither a large
    mean nor an idle stretch costs digits.

    Args:
        x: (n,) first series.
        y: (n,) second series.
        window: samples in a window, at least 2.

    Returns:
        (n,) ρ: NaN where the window is incomplete, holds a NaN or has no variance in x or y.
        (n,) relative variance: the smaller of Sxx / Σx² and Syy / Σy², 0 for constant series.
    """
    n = x.size
    rho = np.full(n, np.nan)
    spread = np.full(n, np.nan)
    if n < window:
        return rho, spread
    suffix = np.empty((window, 5))
    prefix = np.zeros(5)
    one = np.zeros(5)
    both = np.empty(5)
    for start in range(0, n - window + 1, window):
        last = start + window - 1
        suffix[window - 1] = 0.0
        suffix[window - 1, 0] = x[last]
        suffix[window - 1, 1] = y[last]
        for i in range(window - 2, -1, -1):
            one[0] = x[start + i]
            one[1] = y[start + i]
            _merge(suffix[i + 1], window - 1 - i, one, 1, suffix[i])
        for i in range(window):
            k = last + i
            if k >= n:
                break
            if i == 0:
                both[:] = suffix[0]
            else:
                one[0] = x[k]
                one[1] = y[k]
                if i == 1:
                    prefix[:] = one
                else:
                    _merge(prefix, i - 1, one, 1, prefix)
                _merge(suffix[i], window - i, prefix, i, both)
            sxx = both[2]
            syy = both[3]
            total_x = sxx + window * both[0] * both[0]
            total_y = syy + window * both[1] * both[1]
            if np.isnan(sxx + syy):
                continue
            if total_x > 0.0 and total_y > 0.0:
                spread[k] = min(sxx / total_x, syy / total_y)
            else:
                spread[k] = 0.0
            if spread[k] > 1e-24:
                rho[k] = max(-1.0, min(1.0, both[4] / (np.sqrt(sxx) * np.sqrt(syy))))
    return rho, spread


def information_index(rho: Floats) -> Floats:
    """The index (11), -½ ln(1 - ρ) in nat: ρ = 1 → ∞, 0 → 0, -1 → -0.3466; NaN stays NaN.

    It is no mutual information (that would take ρ²) but is monotone in ρ: gating on Î ≥ γ is
    gating on ρ ≥ 1 - exp(-2γ).
    """
    with np.errstate(divide="ignore"):
        return -0.5 * np.log1p(-rho)
