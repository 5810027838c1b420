"""95 % intervals of means over independent repetitions, and of root mean squares by bootstrap."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.paper.paper_limits import LIMITS
from estimators.arrays import Floats


class RmsInterval(NamedTuple):
    """Root mean square and the ends of its interval."""

    rms: float
    low: float
    high: float


def compute_mean_intervals(
    repetitions: pl.DataFrame, group_columns: Sequence[str], values: Sequence[str]
) -> pl.DataFrame:
    """Means over independent repetitions with Student's interval.

    Args:
        repetitions: one row per repetition and group.
        group_columns: columns that define a group.
        values: columns to average; null if a repetition has no value.

    Returns:
        One row per group in order of appearance: `group_columns`, `trials` (number of rows), and
        for each value its mean under the same name with `{value}_low` and `{value}_high`, null
        below two values.
    """
    from scipy.stats import t

    group_columns, values = list(group_columns), list(values)
    means = repetitions.group_by(group_columns, maintain_order=True).agg(
        pl.len().alias("trials"),
        *(pl.col(name).mean() for name in values),
        *(pl.col(name).std().alias(f"{name}_std") for name in values),
        *(pl.col(name).count().alias(f"{name}_count") for name in values),
    )
    columns = [means[name] for name in (*group_columns, "trials")]
    for name in values:
        count = means[f"{name}_count"].to_numpy().astype(float)
        std = means[f"{name}_std"].cast(pl.Float64).fill_null(np.nan).to_numpy()
        # with fewer than two values there is no scatter and no quantile
        quantile = t.ppf(
            (1.0 + LIMITS.confidence_1) / 2.0, np.where(count > 1, count - 1.0, np.nan)
        )
        half = pl.Series(quantile * std / np.sqrt(np.maximum(count, 1.0))).fill_nan(None)
        mean = means[name].cast(pl.Float64)
        columns += [mean, (mean - half).alias(f"{name}_low"), (mean + half).alias(f"{name}_high")]
    return pl.DataFrame(columns)


def bootstrap_rms_and_interval(errors: Floats, rng: np.random.Generator) -> RmsInterval:
    """Root mean square of independent errors with its percentile bootstrap interval.

    The errors may have different variances, like those of windows that start at different phases.

    Args:
        errors: (n,) errors, NaN if a repetition gave none.
        rng: random generator for the resampling.

    Returns:
        R.m.s., low, high; NaN without errors.
    """
    squares = errors[np.isfinite(errors)] ** 2
    n = squares.size
    if n == 0:
        return RmsInterval(np.nan, np.nan, np.nan)
    roots = np.sqrt(
        [squares[rng.integers(n, size=n)].mean() for _ in range(LIMITS.bootstrap_resamples)]
    )
    tail = (1.0 - LIMITS.confidence_1) / 2.0
    low, high = np.quantile(roots, [tail, 1.0 - tail])
    return RmsInterval(float(np.sqrt(squares.mean())), float(low), float(high))


def find_keys_of_lowest_error(errors_by_key: Mapping[float, float]) -> list[float]:
    """Keys of the smallest error, ties included."""
    return [at for at, error in errors_by_key.items() if error == min(errors_by_key.values())]
