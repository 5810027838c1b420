"""Rows labelled by the first condition that holds."""

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl
from numpy.typing import NDArray


def first_index(conditions: Sequence[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    """Number the first condition (n,) that holds for each row, (n,); their count where none does.

    Args:
        conditions: in the order of precedence.
    """
    count = len(conditions)
    chosen = np.full(conditions[0].size, count, np.uint8)
    # the last first, so that the first that holds has the last word
    for number in reversed(range(count)):
        chosen[conditions[number]] = number
    return chosen


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
    return choices.gather(first_index(list(conditions.values())))
