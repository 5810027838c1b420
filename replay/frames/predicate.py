"""Derive the time range of a filter from the tree of a polars expression.

An expression gives its children (`meta.pop`) and a test for equality (`meta.eq`). A node is
identified by building candidates from its children and comparing them, so that nothing depends on
how polars prints or stores expressions. A node that is not recognised does not bound the range.
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, floor, isfinite
from typing import Final, NamedTuple

import polars as pl

_NS_PER_UNIT: Final = {"ns": 1, "us": 1_000, "ms": 1_000_000}
#: First and last instant in ns that fit into 64 bits.
FIRST_NS: Final = -(2**63)
LAST_NS: Final = 2**63 - 1

_MIRRORED: Final[dict[Callable[..., pl.Expr], Callable[..., pl.Expr]]] = {
    operator.ge: operator.le,
    operator.gt: operator.lt,
    operator.le: operator.ge,
    operator.lt: operator.gt,
    operator.eq: operator.eq,
}
_CLOSED: Final = ("both", "left", "right", "none")
#: Types that polars may cast a column of times to before comparing, and the rounding in ns.
_CASTS: Final[tuple[tuple[pl.DataType, int], ...]] = (
    (pl.Datetime("ns"), 0),
    (pl.Datetime("ns", "UTC"), 0),
    (pl.Datetime("us"), 1_000),
    (pl.Datetime("us", "UTC"), 1_000),
    (pl.Datetime("ms"), 1_000_000),
    (pl.Datetime("ms", "UTC"), 1_000_000),
    (pl.Int64(), 0),
    (pl.Int128(), 0),
    # floats near 2^63 have a spacing of 1024
    (pl.Float64(), 2_048),
)


@dataclass(frozen=True, slots=True)
class TimeRange:
    """Log times in ns, both inclusive."""

    first_ns: int = FIRST_NS
    last_ns: int = LAST_NS

    def __and__(self, other: "TimeRange") -> "TimeRange":
        return TimeRange(max(self.first_ns, other.first_ns), min(self.last_ns, other.last_ns))

    def __or__(self, other: "TimeRange") -> "TimeRange":
        return TimeRange(min(self.first_ns, other.first_ns), max(self.last_ns, other.last_ns))


def bound_log_times_by_predicate(predicate: pl.Expr, time_column: str) -> TimeRange:
    """Bound the log times of rows that a predicate may keep.

    Args:
        predicate: any expression; it is false for all rows outside the range.
        time_column: name of the log-time column: ns as Int64, or a Datetime.
    """
    parts = list(reversed(predicate.meta.pop()))
    if len(parts) == 2:
        left, right = parts
        for combine in (operator.and_, operator.or_):
            if combine(left, right).meta.eq(predicate):
                return combine(
                    bound_log_times_by_predicate(left, time_column),
                    bound_log_times_by_predicate(right, time_column),
                )
        return _bound_times_by_comparison(predicate, left, right, time_column)
    if len(parts) == 3:
        values, low, high = parts
        for closed in _CLOSED:
            if values.is_between(low, high, closed=closed).meta.eq(predicate):
                above = operator.ge if closed in ("both", "left") else operator.gt
                below = operator.le if closed in ("both", "right") else operator.lt
                return bound_times_by_constant(
                    values, above, low, time_column
                ) & bound_times_by_constant(values, below, high, time_column)
    return TimeRange()


def _bound_times_by_comparison(
    predicate: pl.Expr, left: pl.Expr, right: pl.Expr, time_column: str
) -> TimeRange:
    """Bound the log times for which a comparison may be true."""
    for compare, mirrored in _MIRRORED.items():
        if compare(left, right).meta.eq(predicate):
            if right.meta.root_names():
                return bound_times_by_constant(right, mirrored, left, time_column)
            return bound_times_by_constant(left, compare, right, time_column)
    return TimeRange()


def bound_times_by_constant(
    time_expression: pl.Expr,
    comparison: Callable[..., pl.Expr],
    constant: pl.Expr,
    time_column: str,
) -> TimeRange:
    """Bound times by a comparison with a constant; unbounded for other expressions."""
    slack = find_time_rounding_ns(time_expression, time_column)
    if slack is None or constant.meta.root_names():
        return TimeRange()
    limit_ns = find_integers_around_constant_ns(constant)
    if limit_ns is None:
        return TimeRange()
    low, high = limit_ns
    first, last = FIRST_NS, LAST_NS
    if comparison in (operator.ge, operator.gt, operator.eq):
        first = low - slack + (comparison is operator.gt and low == high and not slack)
    if comparison in (operator.le, operator.lt, operator.eq):
        last = high + slack - (comparison is operator.lt and low == high and not slack)
    return TimeRange(max(first, FIRST_NS), min(last, LAST_NS))


def find_time_rounding_ns(expression: pl.Expr, time_column: str) -> int | None:
    """Find the rounding in ns of an expression of the time column; None for other expressions."""
    times = pl.col(time_column)
    if expression.meta.eq(times):
        return 0
    for dtype, slack in _CASTS:
        for strict in (True, False):
            if expression.meta.eq(times.cast(dtype, strict=strict)):
                return slack
    return None


class NeighbouringIntegers(NamedTuple):
    """Nearest integers in ns at or below, and at or above, a constant."""

    below_ns: int
    above_ns: int


def find_integers_around_constant_ns(constant: pl.Expr) -> NeighbouringIntegers | None:
    """Find the integers in ns around a constant; None if it is not a number or time in range."""
    try:
        value = pl.select(constant).to_series()
    except pl.exceptions.PolarsError:
        return None
    ns_per_unit = 1
    if isinstance(value.dtype, pl.Date):
        ns_per_unit = 86_400 * 10**9
    elif isinstance(value.dtype, pl.Datetime):
        ns_per_unit = _NS_PER_UNIT[value.dtype.time_unit]
    elif value.dtype.is_temporal():
        return None
    number = value.to_physical()[0] if value.len() == 1 else None
    if isinstance(number, bool) or not isinstance(number, int | float) or not isfinite(number):
        return None
    low, high = floor(number) * ns_per_unit, ceil(number) * ns_per_unit
    return NeighbouringIntegers(low, high) if low > FIRST_NS and high < LAST_NS else None
