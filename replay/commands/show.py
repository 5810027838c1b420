"""`payscope show`: any intermediate of a recording, without a screen."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Format(StrEnum):
    """How a stage is printed."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    stage: Annotated[
        str | None, typer.Argument(help="A stage, such as gate or estimates/ls; none lists them.")
    ] = None,
    start_s: Annotated[
        float | None, typer.Option("--from", help="First second, from the start of the run.")
    ] = None,
    end_s: Annotated[float | None, typer.Option("--to", help="Last second.")] = None,
    output_format: Annotated[
        Format | None,
        typer.Option("--format", help="A table, or what -o ends in, unless given."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write to a file instead.")
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Print a stage of a recording; without a stage, list what it holds."""
    from replay.commands.showing import list_stages, show_stage

    if stage is not None:
        wanted = output_format and output_format.value
        show_stage(recording, stage, start_s, end_s, wanted, output, force=force)
    elif (start_s, end_s, output) != (None, None, None):
        raise typer.BadParameter("--from, --to and -o are for a stage; name one")
    elif output_format not in (None, Format.table, Format.json):
        raise typer.BadParameter("stages are listed as table or json; name one to print it")
    else:
        list_stages(recording, as_json=output_format is Format.json)
