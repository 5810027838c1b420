"""The values of a time column of a known unit as integer nanoseconds."""

from collections.abc import Iterable
from math import isfinite
from typing import Final

import polars as pl

NS_PER_UNIT: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


#: Below so many ns (two hours) a float has a thousandth of one, and need not be split.
_EXACT_NS: Final = 2.0**43


class TimeError(Exception):
    """Why a column is no time axis, in a line."""


def nanoseconds(values: pl.Series, unit: str) -> pl.Series:
    """Times as Int64 ns; null where there is no time.

    Integers are multiplied as integers. A float is split into its whole and its fraction first,
    so that the result is the float's own value rounded to the ns, however large it is.

    Args:
        values: numbers in `unit`, or datetimes or durations, which have their own unit.
        unit: s, ms, us or ns.

    Raises:
        TimeError: the column holds no times, or they do not fit into 64 bit.
    """
    if values.dtype == pl.String:
        values = _parse_text(values)
    dtype = values.dtype
    if dtype.is_temporal():
        return _temporal(values)
    if dtype.is_integer():
        largest = (2**63 - 1) // NS_PER_UNIT[unit]
        _check_range((values.min(), values.max()), largest, unit)
        return values.cast(pl.Int64) * NS_PER_UNIT[unit]
    if not dtype.is_numeric():
        raise TimeError(f"it holds {dtype}, not times")
    return _from_floats(values.cast(pl.Float64), unit)


def _from_floats(values: pl.Series, unit: str) -> pl.Series:
    number, ns = pl.col(values.name), NS_PER_UNIT[unit]
    extremes = values.min(), values.max()
    if not all(isinstance(each, float) and isfinite(each) for each in extremes):
        finite = values.filter(values.is_finite())
        extremes = finite.min(), finite.max()
    _check_range(extremes, (2**63 - 1) // ns - 1, unit)
    if all(isinstance(each, float) and abs(each) * ns < _EXACT_NS for each in extremes):
        return values.to_frame().select(_round_to_integers(number * ns)).to_series()
    whole = number.floor()
    stamps = whole.cast(pl.Int64, strict=False) * ns + _round_to_integers((number - whole) * ns)
    return values.to_frame().select(stamps.alias(values.name)).to_series()


def _round_to_integers(number: pl.Expr) -> pl.Expr:
    return number.round(mode="half_to_even").cast(pl.Int64, strict=False)


def _parse_text(values: pl.Series) -> pl.Series:
    """Numbers or ISO 8601 from the text of a CSV, whichever it mostly is."""
    text = values.str.strip_chars()
    present = text.filter(text.is_not_null() & (text != ""))
    numbers = present.cast(pl.Float64, strict=False)
    if numbers.null_count() * 2 <= present.len():
        integers = text.cast(pl.Int64, strict=False)
        exact = integers.count() == present.len()
        return integers if exact else text.cast(pl.Float64, strict=False)
    try:
        return text.str.to_datetime(time_unit="ns", strict=False)
    except pl.exceptions.PolarsError as error:
        raise TimeError(f"its text is no time ('{present[0]}')") from error


def _temporal(values: pl.Series) -> pl.Series:
    if isinstance(values.dtype, pl.Datetime):
        return values.dt.timestamp("ns")
    if isinstance(values.dtype, pl.Duration):
        return values.dt.total_nanoseconds()
    raise TimeError(f"it holds {values.dtype}, not times")


def _check_range(extremes: Iterable[object], largest: int, unit: str) -> None:
    # as Python numbers: polars compares integers only with what fits into their own dtype
    for extreme in extremes:
        if isinstance(extreme, (int, float)) and abs(extreme) > largest:
            raise TimeError(
                f"{extreme} {unit} does not fit into 64 bit nanoseconds; its unit is wrong"
            )
