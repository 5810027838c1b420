"""Upper limits of a column's noise: its spread, and the residual of the equation."""

from typing import Final

import numpy as np

from analysis.stages.noise.noise_limits import LIMITS
from estimators.arrays import Bools, Floats

#: What a limit leaves to say of where the noise is from.
RESIDUALS: Final = "residuals"
SPREAD: Final = "spread"


def compute_noise_std_limits_by_motion(columns: Floats, is_moving: Bools) -> tuple[Floats, Floats]:
    """Upper limits of each column's noise standard deviation, (columns,) each.

    Args:
        columns: (rows, columns) acceleration, speed and force, or those of a turn; may have gaps.
        is_moving: (rows,) whether the machine moves.

    Returns:
        The spread of each column; and the residual of force = m a + b v + c v|v| + d sign(v) + e
        over the column's coefficient, infinite for a coefficient of 0.
    """
    columns = columns[is_moving]
    spread = columns.std(axis=0) if len(columns) else np.full(columns.shape[1], np.inf)
    left = np.full(columns.shape[1], np.inf)
    if columns.shape[1] == 3 and len(columns) > LIMITS.residual_min_rows:
        a, v, force = columns.T
        A = np.column_stack([a, v, v * np.abs(v), np.sign(v), np.ones(v.size)])
        theta = np.linalg.lstsq(A, force, rcond=None)[0]
        residual = float(np.sqrt(((force - A @ theta) ** 2).sum() / (len(columns) - A.shape[1])))
        if theta[0] > 0.0:
            left[0], left[2] = residual / theta[0], residual
    return spread, left


def clip_covariances(
    covariances: Floats,
    sources: list[str],
    columns: Floats,
    is_moving: Bools,
    derivative_of: list[int],
) -> None:
    """Reduce covariances that exceed their limit, in place, with those of derivatives.

    Args:
        covariances: (columns, columns, LAGS) covariances.
        sources: source of each column's noise; noise seen at standstill is not changed.
        columns: (rows, columns) values.
        is_moving: (rows,) whether the machine moves.
        derivative_of: the column that each is the derivative of, -1 for none.
    """
    spread, left = compute_noise_std_limits_by_motion(columns, is_moving)
    std = np.sqrt(np.maximum(np.diagonal(covariances[:, :, 0]), 0.0))
    for column, source in enumerate(sources):
        limit = min(spread[column], left[column])
        if source == "standstill" or not std[column] > LIMITS.excess_ratio * limit:
            continue
        share = limit / std[column]
        for each in {column, derivative_of[column]} - {-1}:
            if sources[each] == "standstill":
                continue
            covariances[each, :] *= share
            covariances[:, each] *= share
            std[each] *= share
            sources[each] = SPREAD if spread[column] < left[column] else RESIDUALS
