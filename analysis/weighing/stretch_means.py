"""Means of a stretch's samples, and what is left of them without a constant and a slope."""

from typing import Final

import numpy as np

from analysis.weighing.motion_samples import Floats
from estimators.compiled import compiled

#: Means of so many samples are compared; stretches shorter than ten of them are not.
MEAN: Final = 10
#: Means so near hold nearly the same.
EVERY: Final = 3


@compiled
def overlapping_means(x: Floats) -> Floats:
    """Means of `MEAN` samples, one every `EVERY`."""
    out = np.empty((x.size - MEAN) // EVERY + 1)
    for i in range(out.size):
        out[i] = x[i * EVERY : i * EVERY + MEAN].sum() / MEAN
    return out


@compiled
def subtract_line(x: Floats) -> Floats:
    """The same without a constant and a slope."""
    middle = (x.size - 1) / 2.0
    ramp = np.arange(x.size) - middle
    slope = (ramp * x).sum() / (ramp * ramp).sum()
    return x - x.sum() / x.size - slope * ramp
