"""`payscope plot`: draw pictures of a recording."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class FigureName(StrEnum):
    """Name of a figure of `recordings.plots.run_plots.FIGURES`; each answers a question."""

    page = "page"
    force_acceleration = "force-acceleration"
    convergence = "convergence"
    gate = "gate"
    loads = "loads"


def command(
    recording: Annotated[Path, typer.Argument(help="A recording (.rrd).")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The picture (.png, .pdf or .svg).")
    ],
    figure: Annotated[
        FigureName, typer.Option("--figure", help="One page with everything, or a single figure.")
    ] = FigureName.page,
    at_s: Annotated[
        float | None,
        typer.Option("--at", help="Mark this second, and draw the 30 s around it."),
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", help="Start of the time span to draw (s).")
    ] = None,
    to_s: Annotated[float | None, typer.Option("--to", help="End of the time span (s).")] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing picture.")] = False,
) -> None:
    """Draw a recording: forces, motion, index, gate, masses and the answer on one page.

    Or one figure a question: --figure force-acceleration, convergence, gate or loads. Long runs are
    drawn by envelopes, medians and shares of time; --from and --to show the detail.
    """
    from replay.recording.view_recording import plot_recording

    picture = plot_recording(
        recording, output, figure.value, at_s=at_s, from_s=from_s, to_s=to_s, overwrites=force
    )
    typer.echo(str(picture))
