"""Options that several commands have."""

from enum import StrEnum
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from replay.readers import TimeAxis


class FrameFormat(StrEnum):
    """How a frame is printed or written."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"


_UNITS = ("s", "ms", "us", "ns")


def time_axis_of(column: str | None, unit: str) -> "TimeAxis | None":
    """Where a table keeps its time; None where it is to be guessed.

    Raises:
        BadParameter: no such unit, or a unit of no column.
    """
    from replay.readers import TimeAxis

    if unit not in _UNITS:
        raise typer.BadParameter(f"no unit of time '{unit}'; use {', '.join(_UNITS)}")
    if column is None and unit != "s":
        raise typer.BadParameter("--time-unit is the unit of --time: name that column too")
    return TimeAxis(column, unit) if column else None
