"""The values of a time column of a known unit as integer nanoseconds."""

from typing import Final

import numpy as np
import polars as pl

NS_PER_UNIT: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


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
        _check_range(values, largest, unit)
        return values.cast(pl.Int64) * NS_PER_UNIT[unit]
    if not dtype.is_numeric():
        raise TimeError(f"it holds {dtype}, not times")
    return _from_floats(values.cast(pl.Float64), unit)


def _from_floats(values: pl.Series, unit: str) -> pl.Series:
    finite = values.is_finite().fill_null(value=False)
    _check_range(values.filter(finite), (2**63 - 1) // NS_PER_UNIT[unit] - 1, unit)
    seconds = values.zip_with(finite, pl.Series([0.0])).to_numpy()
    whole = np.floor(seconds)
    fraction = np.rint((seconds - whole) * NS_PER_UNIT[unit])
    stamps = whole.astype(np.int64) * NS_PER_UNIT[unit] + fraction.astype(np.int64)
    return pl.Series(values.name, stamps).zip_with(finite, pl.Series([None], dtype=pl.Int64))


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


def _check_range(values: pl.Series, largest: int, unit: str) -> None:
    # as Python numbers: polars compares integers only with what fits into their own dtype
    for extreme in (values.min(), values.max()):
        if isinstance(extreme, (int, float)) and abs(extreme) > largest:
            raise TimeError(
                f"{extreme} {unit} does not fit into 64 bit nanoseconds; its unit is wrong"
            )
