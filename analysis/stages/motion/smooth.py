"""The paper's trailing moving mean (10 samples), applied equally to every column."""

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.column_arrays import ColumnArrays
from analysis.model.schema import build_frame, get_column_values
from analysis.model.settings import SmoothSettings


def smooth_by_trailing_mean(aligned: pl.DataFrame, settings: SmoothSettings) -> pl.DataFrame:
    """Replace each sample by a trailing mean: of itself and those before it, `samples` in all.

    The mean never reaches across a gap: a row is null until its whole mean is inside one gap-free
    stretch. Every column is averaged equally, the Coulomb sign included, since a column filtered
    differently from the force biases the mass.

    Args:
        aligned: the grid.
        settings: settings with `samples`.

    Returns:
        The same columns, null in rows near a gap.
    """
    return build_frame("aligned", smooth_columns_by_trailing_mean(aligned, settings))


def smooth_columns_by_trailing_mean(
    aligned: pl.DataFrame | ColumnArrays, settings: SmoothSettings
) -> ColumnArrays:
    """Columns of the frame that `smooth_by_trailing_mean` makes, NaN in rows near a gap."""
    t_ns, gap = np.asarray(aligned["t_ns"]), np.asarray(aligned["gap"])
    columns: dict[str, NDArray[np.float64]] = {}
    for name in aligned.columns:
        if name in ("t_ns", "gap"):
            continue
        x = np.where(gap, np.nan, get_column_values(aligned, name))
        columns[name] = compute_trailing_mean(x, settings.samples)
    return ColumnArrays(t_ns=t_ns, **columns, gap=gap)


def compute_trailing_mean(signal: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Mean (rows,) of each sample and the `samples` - 1 before it; NaN if any of these is NaN."""
    # each output is its own sum: a running sum would carry a NaN, and rounding, to the end
    total = np.convolve(signal, np.ones(samples))[: signal.size] if signal.size else signal
    mean = total / samples
    mean[: samples - 1] = np.nan
    return mean
