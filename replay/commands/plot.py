"""`payscope plot`: a page of pictures."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The picture (.png, .pdf or .svg).")
    ],
    force: Annotated[bool, typer.Option(help="Replace an existing picture.")] = False,
) -> None:
    """Draw a recording on one page: forces, motion, index, gate, masses, the answer."""
    from recordings import plot_run, read_recording
    from recordings.output import check_output

    check_output(output, force=force)
    typer.echo(str(plot_run(read_recording(recording), output, force=force)))
