"""What cycles of one product, operator or customer add up to."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import polars as pl

from analysis.cycles.shift_totals import sum_cycles


class LabelTotal(NamedTuple):
    """The counted loads with one label.

    Attributes:
        label: the text; empty for loads that have none.
        loads: how many.
        payload_kg: their sum.
        payload_u_kg: its standard uncertainty.
    """

    label: str
    loads: int
    payload_kg: float
    payload_u_kg: float


def label_totals(
    cycles: pl.DataFrame, labels: Sequence[str], rejected: Collection[int] = ()
) -> list[LabelTotal]:
    """The sum of each label, by label; none where no cycle has one.

    Parts that are common to all loads are in each sum: the uncertainties of two labels do not add
    up in squares.

    Args:
        cycles: frame `cycles`.
        labels: of each row; empty where it has none.
        rejected: numbers of cycles that are not counted.
    """
    if not any(labels):
        return []
    found: list[LabelTotal] = []
    named = cycles.with_columns(pl.Series("label", labels, dtype=pl.String))
    for label in sorted(set(labels), key=lambda each: (each == "", each)):
        sums = sum_cycles(named.filter(label=label).drop("label"), rejected)
        total = LabelTotal(label, sums["cycles_counted"], sums["payload_kg"], sums["payload_u_kg"])
        if total.loads:
            found.append(total)
    return found
