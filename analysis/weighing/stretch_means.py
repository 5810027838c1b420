"""Means within a stretch, and their residuals about a line."""

from functools import cache
from typing import Final

import numpy as np

from analysis.weighing.motion_samples import Floats, Ints
from estimators.interpreted import compiled_unless_short_log
from estimators.numerics.fit_loss import list_rows_by_group
from estimators.numerics.in_order import sum_in_order

#: Samples in a mean; stretches shorter than ten means are not compared.
MEAN: Final = 10
#: Samples from one mean to the next; closer means contain nearly the same samples.
EVERY: Final = 3


@compiled_unless_short_log
def compute_overlapping_means(samples: Floats) -> Floats:
    """Overlapping means (means,) of `MEAN` samples, one every `EVERY`."""
    out = np.empty((samples.size - MEAN) // EVERY + 1)
    for i in range(out.size):
        out[i] = sum_in_order(samples[i * EVERY : i * EVERY + MEAN]) / MEAN
    return out


@compiled_unless_short_log
def subtract_fitted_line(values: Floats) -> Floats:
    """Residual (n,) of a linear fit."""
    middle = (values.size - 1) / 2.0
    ramp = np.arange(values.size) - middle
    slope = sum_in_order(ramp * values) / sum_in_order(ramp * ramp)
    return values - sum_in_order(values) / values.size - slope * ramp


def make_constant_and_slope_of_each_stretch(stretch_of_row: Ints) -> Floats:
    """A constant and a slope column for each stretch, (rows, 2)."""
    return np.concatenate(
        [
            make_orthonormal_constant_and_slope(part.size)
            for part in list_rows_by_group(stretch_of_row)
        ]
    )


@cache
def make_orthonormal_constant_and_slope(samples: int) -> Floats:
    """Orthonormal columns of a constant and a slope, (samples, 2)."""
    ramp = np.linspace(-1.0, 1.0, samples)
    return np.linalg.qr(np.column_stack([np.ones(samples), ramp]))[0]
