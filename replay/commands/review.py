"""`payscope review`: the logs of a shift in, its tonnes and their worth out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.commands.common_options import Calibration, RequireSigned, SignerKey, read_calibration

if TYPE_CHECKING:
    from rich.console import Console

    from replay.review.review_shift import ShiftReview


def command(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs of one shift, or a folder of them, in any order.")
    ],
    machine: Annotated[Path, typer.Option("-m", "--machine", help="The machine file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the review.")],
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    target: Annotated[
        float | None,
        typer.Option(metavar="KG", min=1e-3, help="Judge loads against KG by the 10/10/20 rule."),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    full: Annotated[
        bool, typer.Option("--full", help="Keep every sample and intermediate in shift.rrd.")
    ] = False,
    timing: Annotated[bool, typer.Option(help="Print the duration of each stage.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the sums as JSON.")] = False,
) -> None:
    """Review a shift: ledger, recording and one page with tonnes, cycles and what is wrong.

    Exit status 1 if no cycle counts; stderr and the page say why.
    """
    from estimators.errors import one_line
    from recordings.review.review_page import headline
    from replay.commands.print_tables import console, print_json
    from replay.commands.progress_bar import Stages
    from replay.pipeline import STAGES
    from replay.review.review_shift import ReviewOptions, review

    asked = read_calibration(calibration, key, signed=require_signed)
    options = ReviewOptions(overrides or [], asked, target, full)
    with Stages(len(STAGES) + 3, timing=timing) as stages:
        made = review(logs, machine, output, options, stages.begin)
    if as_json:
        print_json(made.to_dict())
    else:
        print_review(console(), made)
    if made.no_tonnes:
        typer.echo(one_line(headline(made.shift, made.no_tonnes)), err=True)
        raise typer.Exit(1)


def print_review(screen: "Console", made: "ShiftReview") -> None:
    """Print a review's sums, what is wrong with it, and where its page is.

    Why there are no tonnes is a message, which the command prints on stderr.
    """
    from recordings.review.review_page import (
        NOT_CALIBRATED,
        PAGE,
        breakdown,
        facts,
        headline,
        missing_loads,
        two_machines,
    )
    from replay.commands.print_tables import print_line

    if not made.no_tonnes:
        print_line(screen, headline(made.shift, ""))
    if made.state.mixed_machines:
        print_line(screen, f"warning: {two_machines(made.state)}")
    for sentence in missing_loads(made.shift):
        print_line(screen, sentence)
    for name, value in (*facts(made.shift, made.target), *breakdown(made.ledger)):
        print_line(screen, f"{name}: {value}")
    if made.calibration.against:
        print_line(screen, f"{NOT_CALIBRATED}: {made.calibration.against}")
    elif made.calibration.says:
        print_line(screen, made.calibration.says)
    failed = [check.check for check in made.state.failed]
    if failed:
        print_line(screen, f"checks that failed: {', '.join(failed)}")
    for loss in made.state.losses:
        print_line(screen, f"lost: {loss}")
    if not made.replayed:
        print_line(screen, "not replayed: logs, machine and settings are those of the last review")
    print_line(screen, f"page: {made.folder / PAGE}")
