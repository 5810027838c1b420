"""Find time columns by their cells, and contradictions between time columns."""

from collections.abc import Callable, Sequence

import polars as pl

from replay.logs.tables.dates import convert_clock_times_and_list_notes, has_time_of_day
from replay.logs.tables.header import ColumnName
from replay.logs.tables.table_limits import LIMITS
from replay.logs.tables.times import NS_PER_UNIT, TimeError, convert_times_to_ns


def find_sole_time_column(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]]
) -> list[int]:
    """Index of the only column that contains times; empty if there is none or several.

    Such a column has times of day to the second, or a unit of time and values that increase
    strictly.
    """
    clocks = [k for k in range(len(columns)) if are_cells_advancing_clock_times(cells(k))]
    if clocks:
        return clocks if len(clocks) == 1 else []
    rising = [
        k
        for k, column in enumerate(columns)
        if column.unit in NS_PER_UNIT and are_cells_strictly_increasing(cells(k))
    ]
    return rising if len(rising) == 1 else []


def are_cells_advancing_clock_times(cells: list[str]) -> bool:
    """Whether cells are times of day to the second that are not all equal."""
    return (
        len(set(cells)) > 1
        and has_time_of_day(cells[0])
        and all(cell.count(":") > 1 and has_time_of_day(cell) for cell in cells)
    )


def are_cells_strictly_increasing(cells: list[str]) -> bool:
    """Whether the cells are strictly increasing numbers."""
    numbers = pl.Series(cells, dtype=pl.String).str.replace(",", ".").cast(pl.Float64, strict=False)
    steps = numbers.diff().drop_nulls()
    return (
        numbers.len() >= LIMITS.rising_min_rows
        and steps.len() == numbers.len() - 1
        and bool((steps > 0).all())
    )


def describe_contradicting_time_column(
    columns: Sequence[ColumnName],
    cells: Callable[[int], list[str]],
    time_column: str,
    log_times: pl.Series,
) -> str | None:
    """Say which other time column gives a different duration of the first rows.

    Args:
        columns: columns of the table.
        cells: returns the first cells of a column, by index.
        time_column: detected time column.
        log_times: times of the first rows by that column, in ns.

    Returns:
        The sentence; None if the times agree.
    """
    taken_s = compute_span_if_increasing_s(log_times)
    if taken_s is None:
        return None
    for place, column in enumerate(columns):
        own = cells(place) if column.name != time_column else []
        if len(own) != log_times.len() or not _may_column_be_time(column, own):
            continue
        other_s = _compute_time_span_of_column_s(column, own)
        if other_s is None:
            continue
        if abs(other_s - taken_s) > LIMITS.clock_drift_s + LIMITS.clock_drift_fraction * max(
            other_s, taken_s
        ):
            return (
                f"its first {log_times.len()} rows span {taken_s:.3g} s, but {other_s:.3g} s "
                f"according to '{column.name}': set [log] time to the correct column, and time_unit"
            )
    return None


def _may_column_be_time(column: ColumnName, cells: list[str]) -> bool:
    named = column.unit in NS_PER_UNIT and "time" in column.bare.lower()
    return named or are_cells_advancing_clock_times(cells)


def _compute_time_span_of_column_s(column: ColumnName, cells: list[str]) -> float | None:
    text = pl.Series(column.name, cells, dtype=pl.String)
    try:
        if are_cells_advancing_clock_times(cells):
            return compute_span_if_increasing_s(
                convert_clock_times_and_list_notes(None, text, None).stamps
            )
        return (
            compute_span_if_increasing_s(convert_times_to_ns(text, column.unit or "s"))
            if are_cells_strictly_increasing(cells)
            else None
        )
    except TimeError:
        return None


def compute_span_if_increasing_s(stamps: pl.Series) -> float | None:
    """Seconds from first to last stamp; None if stamps decrease, are all equal or too few."""
    there = stamps.drop_nulls()
    if there.len() < LIMITS.rising_min_rows or (there.diff() < 0).any():
        return None
    span_s = (int(there[-1]) - int(there[0])) / 1e9
    return span_s if span_s > 0 else None
