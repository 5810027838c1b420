"""`payscope sweep`: Tables 3 and 4 on any log."""

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Format(StrEnum):
    """How the rows are printed."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"


def command(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs (.bag, .mcap, rosbag2, .db3, .csv, .parquet).")
    ],
    machine: Annotated[Path, typer.Option("-m", "--machine", help="The machine file.")],
    over: Annotated[
        list[str],
        typer.Option(
            "--over",
            metavar="KEY=VALUES",
            help="What to vary: KEY=FROM:TO:STEP (both ends included) or KEY=A,B,C; "
            "repeat it for a grid.",
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    reference_kg: Annotated[
        float | None,
        typer.Option("--reference", metavar="KG", help="The true mass: adds each mass's error."),
    ] = None,
    output_format: Annotated[
        Format | None,
        typer.Option("--format", help="A table, or what -o ends in, unless given."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As --format json.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write to a file instead.")
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Replay logs over the values of settings: masses, accepted share and verdict of each.

    With the truth of a simulation beside the logs, root mean square errors of the runs' masses as
    in the paper's Tables 3 and 4. A combination that cannot weigh is marked and has no mass.
    Exit status 1 when none can.
    """
    from replay.commands.sweeping import print_sweep

    if as_json and output_format not in (None, Format.json):
        raise typer.BadParameter("--json and --format differ; give one of them")
    if reference_kg is not None and not 0.0 < reference_kg < math.inf:
        raise typer.BadParameter(f"--reference {reference_kg:g}: give a mass in kg, above 0")
    wanted = Format.json if as_json else output_format
    weighs = print_sweep(
        logs,
        machine,
        overrides or [],
        over,
        reference_kg=reference_kg,
        output_format=wanted and wanted.value,
        output=output,
        force=force,
    )
    if not weighs:
        typer.echo("No combination can weigh: every mass is withheld.", err=True)
        raise typer.Exit(1)
