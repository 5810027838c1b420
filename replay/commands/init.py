"""`payscope init`: a first machine file."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    log: Annotated[Path, typer.Argument(help="The log.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The machine file to write.")],
    time: Annotated[str | None, typer.Option(help="The time column of a table.")] = None,
    time_unit: Annotated[str, typer.Option(help="Its unit: s, ms, us or ns.")] = "s",
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Draft a machine file from the contents of a log, to be checked and completed by hand."""
    from recordings.output import keep_apart, whole_file
    from replay.commands.options import time_axis_of
    from replay.guess import draft_machine_file
    from replay.guess_priors import prior_lines
    from replay.readers import open_log

    axis = time_axis_of(time, time_unit)
    with open_log(log, time=axis) as opened:
        keep_apart(output, opened.files)
        text, lacking = draft_machine_file(opened, axis)
        if not lacking:
            text += "\n".join(["", *prior_lines(opened, text)])
    with whole_file(output, force=force) as partial:
        partial.write_text(text, encoding="utf-8")
    for sentence in lacking:
        typer.echo(f"still missing: {sentence}", err=True)
    typer.echo(str(output))
