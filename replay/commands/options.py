"""Options that several commands have."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from replay.calibrated import AskedCalibration
    from replay.readers import TimeAxis


class FrameFormat(StrEnum):
    """How a frame is printed or written."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"


#: Evidence that calibrates the masses of loads, and what is asked of it.
Calibration = Annotated[
    Path | None,
    typer.Option("--calibration", metavar="DIR", help="Evidence that calibrates the masses."),
]
SignerKey = Annotated[
    Path | None,
    typer.Option("--key", help="Public key (PEM) that the evidence has to be signed with."),
]
RequireSigned = Annotated[
    bool,
    typer.Option(
        "--require-signed",
        help="Refuse evidence without a signature by --key, or by a key of the keyring.",
    ),
]


def asked_calibration(
    folder: Path | None, key: Path | None, *, signed: bool
) -> "AskedCalibration | None":
    """What is asked for by these options.

    Raises:
        BadParameter: what is asked of evidence, without any.
    """
    if folder is None:
        if key is not None or signed:
            raise typer.BadParameter("--key and --require-signed are of --calibration")
        return None
    from replay.calibrated import AskedCalibration
    from replay.commands.first_use import first_use

    return AskedCalibration(folder, key, signed, first_use())


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
