"""`payscope view`: open a recording in the Rerun viewer, or take pictures of it."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="TIME",
            help="Move the time cursor to this second of the run, or to a time in UTC "
            "(2026-11-23T06:12:03.5Z).",
        ),
    ] = None,
    from_s: Annotated[
        float | None,
        typer.Option(
            "--from", help="Start of the time span to open (s); a long run then shows its detail."
        ),
    ] = None,
    to_s: Annotated[float | None, typer.Option("--to", help="End of the time span (s).")] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(help="Write a picture of each tab into this folder, without a screen."),
    ] = None,
    tab: Annotated[
        str | None, typer.Option(help="With --screenshot: capture this tab only.")
    ] = None,
) -> None:
    """Open a recording in the Rerun viewer (listens on 127.0.0.1 only), or take its screenshots."""
    from replay.recording.view_recording import parse_moment_of_run_s, view_recording

    at_s = None if at is None else parse_moment_of_run_s(recording, at)
    for each in view_recording(
        recording, from_s, to_s, at_s=at_s, screenshot=screenshot, tab_title=tab
    ):
        typer.echo(str(each))
