"""Means within a stretch, and their residuals about a line."""

from functools import cache
from typing import Final

import numpy as np

from analysis.weighing.motion_samples import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.fit_loss import list_rows_by_group
from estimators.numerics.in_order import sum_axis_in_order

#: Samples in a mean; stretches shorter than ten means are not compared.
MEAN: Final = 10
#: Samples from one mean to the next; closer means contain nearly the same samples.
EVERY: Final = 3


@compiled_unless_short_log
def compute_overlapping_means(samples: Floats) -> Floats:
    """Overlapping means (means,) of `MEAN` samples, one every `EVERY`."""
    out = np.empty((samples.size - MEAN) // EVERY + 1)
    for i in range(out.size):
        total = 0.0
        for k in range(i * EVERY, i * EVERY + MEAN):
            total += samples[k]
        out[i] = total / MEAN
    return out


def _subtract_fitted_line_vectorised(values: Floats) -> Floats:
    ramp = np.arange(values.size) - (values.size - 1) / 2.0
    along, square, total = sum_axis_in_order(np.stack([ramp * values, ramp * ramp, values]), 1)
    return values - total / values.size - along / square * ramp


@compiled_with_array_form(_subtract_fitted_line_vectorised)
def subtract_fitted_line(values: Floats) -> Floats:
    """Residual (n,) of a linear fit."""
    n = values.size
    middle = (n - 1) / 2.0
    along = square = total = 0.0
    for k in range(n):
        along += (k - middle) * values[k]
        square += (k - middle) * (k - middle)
        total += values[k]
    slope, mean = along / square, total / n
    out = np.empty(n)
    for k in range(n):
        out[k] = values[k] - mean - slope * (k - middle)
    return out


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


def list_indices_of_samples_in_whole_blocks(stretch_of_sample: Ints, block_size: int) -> Ints:
    """Indices of the samples in whole blocks of the given size within each stretch."""
    own = [
        part[: part.size // block_size * block_size]
        for part in list_rows_by_group(stretch_of_sample)
    ]
    return np.concatenate([np.zeros(0, np.int64), *own]).astype(np.int64)
