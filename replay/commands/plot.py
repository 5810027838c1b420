"""`payscope plot`: a page of pictures."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The picture (.png, .pdf or .svg).")
    ],
    from_s: Annotated[
        float | None, typer.Option("--from", help="Draw only what begins here (s).")
    ] = None,
    to_s: Annotated[float | None, typer.Option("--to", help="And ends here (s).")] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing picture.")] = False,
) -> None:
    """Draw a recording on one page: forces, motion, index, gate, masses, the answer."""
    from recordings import plot_run
    from recordings.output import check_output
    from recordings.window import read_window

    check_output(output, force=force)
    typer.echo(str(plot_run(read_window(recording, from_s, to_s), output, force=force)))
