"""`payscope view`: the Rerun viewer."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    at_s: Annotated[
        float | None, typer.Option("--at", help="Move the time cursor to this second of the run.")
    ] = None,
) -> None:
    """Open a recording in the Rerun viewer (listens on 127.0.0.1 only)."""
    from recordings.viewer import open_viewer

    open_viewer(recording, at_s)
