"""Rows labelled by the first condition that holds."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray


def first_that_holds(
    conditions: Mapping[str | None, NDArray[np.bool_]], otherwise: str, labels: pl.Enum
) -> pl.Series:
    """Label rows (n,), each by the first condition (n,) that holds for it.

    Args:
        conditions: by label, in the order of precedence; the label None is null.
        otherwise: the label where none holds.
        labels: of the series.
    """
    # numbers, since rows of text are slow to make
    choices = pl.Series([*conditions, otherwise], dtype=labels)
    numbers = np.arange(len(conditions), dtype=np.uint8)
    chosen = np.select(list(conditions.values()), list(numbers), np.uint8(len(conditions)))
    return choices.gather(chosen)
