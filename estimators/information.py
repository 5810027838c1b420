"""The information index (11) between acceleration and force over a sliding window."""

import numpy as np

from estimators.compiled import compiled
from estimators.rolling import pairs_of_blocks, sum_pair, workspace
from estimators.trace import Floats, Ints

#: A smaller share of Σx² than this is rounding, not variance.
_NO_SPREAD = 1e-24


def window_correlation(x: Floats, y: Floats, window: int) -> tuple[Floats, Floats]:
    """Pearson's ρ of x and y over every run of exactly `window` samples.

    From sums of deviations (see `estimators.rolling`), so that neither a large mean nor an idle
    stretch costs digits.

    Args:
        x: (n,) first series.
        y: (n,) second series.
        window: samples in a window, at least 2.

    Returns:
        (n,) ρ: NaN where the window is incomplete, holds a NaN or has no variance in x or y.
        (n,) relative variance: the smaller of Sxx / Σx² and Syy / Σy², 0 for constant series.
    """
    rho = np.full(x.size, np.nan)
    spread = np.full(x.size, np.nan)
    if x.size >= window:
        every = np.arange(window - 1, x.size)
        _correlate(x.reshape(-1, 1), y, window, every, rho[window - 1 :], spread[window - 1 :])
    return rho, spread


@compiled
def _correlate(A: Floats, f: Floats, window: int, index: Ints, rho: Floats, spread: Floats) -> None:
    """ρ of the only column of A and f, and its relative variance, for the windows in index."""
    work = workspace(2, window)
    pairs = pairs_of_blocks(window, index)
    for number in range(pairs.size - 1):
        row: int = pairs[number]
        end: int = pairs[number + 1]
        sum_pair(A, f, window, index, row, end, work)
        correlation(work.moments, work.centre, window, rho[row:end], spread[row:end])


@compiled
def correlation(moments: Floats, centre: Floats, window: int, rho: Floats, spread: Floats) -> None:
    """ρ and relative variance (m,) from the moments of two series (see `rolling.Workspace`)."""
    dx, dy, dxx, dxy, dyy = moments[0], moments[1], moments[2], moments[3], moments[4]
    for k in range(rho.size):
        x, y = dx[k] / window, dy[k] / window
        sxx, sxy, syy = dxx[k] - x * dx[k], dxy[k] - x * dy[k], dyy[k] - y * dy[k]
        # a window of one value has deviations of exactly zero
        of_x = sxx / (sxx + window * (centre[0] + x) ** 2) if sxx > 0.0 else 0.0 * sxx
        of_y = syy / (syy + window * (centre[1] + y) ** 2) if syy > 0.0 else 0.0 * syy
        least = of_x if of_x < of_y or np.isnan(of_x) else of_y
        value = sxy / (np.sqrt(sxx) * np.sqrt(syy))
        value = 1.0 if value > 1.0 else value
        value = -1.0 if value < -1.0 else value
        spread[k] = least
        rho[k] = value if least > _NO_SPREAD else np.nan


def information_index(rho: Floats) -> Floats:
    """The index (11), -½ ln(1 - ρ) in nat: ρ = 1 → ∞, 0 → 0, -1 → -0.3466; NaN stays NaN.

    It is no mutual information (that would take ρ²) but is monotone in ρ: gating on Î ≥ γ is
    gating on ρ ≥ 1 - exp(-2γ).
    """
    with np.errstate(divide="ignore"):
        return -0.5 * np.log1p(-rho)
