"""Ground that holds the machine by another force from place to place.

A start on soft ground and one on hard ground differ by a constant force, which a mass alone would
have to take. How much such constants scatter is told by the stretches themselves, each with a mass
of its own; a scatter that chance explains is none.
"""

from typing import Final

import numpy as np

from analysis.weighing.averages import Averages, stride_of
from analysis.weighing.equation import Floats
from estimators.autocorrelation import pooled_autocorrelation
from estimators.between_variance import between_variance
from estimators.fit_loss import group_ids, group_rows

#: Chance makes constants differ as much with this probability: in few logs of a thousand.
_BY_CHANCE: Final = 1e-3
#: Fewer stretches do not tell how they scatter.
_FEWEST: Final = 6


def ground_scatter(rows: Averages, shared: Floats, samples: int, rate_hz: float) -> float:
    """Variance of the stretches' constants over that of the noise of a second's mean, in 1/s.

    0 where chance explains them (`between_variance`).

    Args:
        rows: what is fitted: acceleration first.
        shared: (p - 1,) parameters of the other columns, which all stretches share.
        samples: of a mean.
        rate_hz: of the grid.
    """
    left = rows.f - rows.A[:, 1:] @ shared
    index = np.full(rows.f.size, -1, np.int64)
    residual = np.zeros(rows.f.size)
    means, squares = [], []
    parts = dict(zip(group_ids(rows.group).tolist(), group_rows(rows.group), strict=True))
    told = {number: part for number, part in parts.items() if part.size >= rows.shortest}
    if len(told) < _FEWEST:
        return 0.0
    for number, part in told.items():
        own = np.column_stack([rows.A[part, 0], np.ones(part.size)])
        fitted = np.linalg.lstsq(own, left[part])[0]
        residual[part] = left[part] - own @ fitted
        index[part] = number
        a = own[:, 0]
        # what of a constant the acceleration does not take
        squares.append(part.size - a.sum() ** 2 / (a @ a))
        means.append(fitted[1] * rows.direction[part[0]])
    correlation, _ = pooled_autocorrelation(residual, index, None)
    white = float(residual @ residual) / max(int((index >= 0).sum()) - 2 * len(told), 1)
    noise = white * max(2.0 * float(correlation.sum()) - 1.0, 1.0)
    if not noise > 0.0:
        return 0.0
    constant, weight = np.array(means), np.array(squares) / noise
    # one that is far from all others is no ground: a load that changes, a stop
    far = np.argmax(weight * (constant - np.median(constant)) ** 2)
    constant, weight = np.delete(constant, far), np.delete(weight, far)
    variance = between_variance(constant, weight, _BY_CHANCE)
    rows_a_second = rate_hz / stride_of(samples)
    return variance * rows_a_second / noise
