"""`payscope info`: what is in a log."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer


def command(
    logs: Annotated[list[Path], typer.Argument(help="Logs to describe.")],
    time: Annotated[str | None, typer.Option(help="The time column of a table.")] = None,
    time_unit: Annotated[str, typer.Option(help="Its unit: s, ms, us or ns.")] = "s",
    check: Annotated[
        bool,
        typer.Option("--check", help="Read and decode everything; status 1 if anything is lost."),
    ] = False,
    timezone: Annotated[str, typer.Option(help="The time zone to read times in.")] = "UTC",
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Show topics, types, counts, rates and gaps, by the log's index where it has one.

    Damage shows only where that look came upon it. With --check every message of every topic is
    read and walked to its end, every CRC compared and the index held against what is there: then
    all damage shows, and the exit status is 1 unless the log is whole.
    """
    from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

    from estimators.errors import LogError
    from replay.commands.printing import console, print_json
    from replay.commands.progress import Stages
    from replay.commands.table_time import time_axis_of
    from replay.info import describe, show
    from replay.readers import open_log

    try:
        zone = ZoneInfo(timezone)
    except (ZoneInfoNotFoundError, ValueError):
        raise typer.BadParameter(
            f"no time zone '{timezone}'; use a name like America/Santiago or UTC"
        ) from None
    axis = time_axis_of(time, time_unit)
    described: list[object] = []
    faults: list[LogError] = []
    is_whole = True
    for path in logs:
        try:
            with (
                open_log(path, time=axis) as log,
                Stages(1) if check else nullcontext(),
            ):
                shown = describe(log, check=check)
        except LogError as error:
            # the other logs are still worth describing
            faults.append(error)
            continue
        is_whole = is_whole and shown.is_whole is not False
        if as_json:
            described.append(shown.to_dict())
        else:
            show(shown, zone, console())
            typer.echo()
    if as_json and described:
        print_json(described[0] if len(logs) == 1 else described)
    for error in faults[:-1]:
        typer.echo(f"payscope: {error}", err=True)
    if faults:
        raise faults[-1]
    if not is_whole:
        raise typer.Exit(1)
