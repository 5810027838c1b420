"""`payscope reproduce`: reproduce the paper's tables, figures and claims by simulated trials."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class ReproductionFormat(StrEnum):
    """Format of the tables and sentences."""

    md = "md"
    csv = "csv"


def command(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the files to write.")],
    items: Annotated[
        list[str] | None,
        typer.Argument(help="table1 … table4, fig2 … fig8, claims; all of them by default."),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(
            min=2,
            help="Simulated windows of each length in Table 1; a fifth as many long cruises.",
        ),
    ] = 250,
    campaigns: Annotated[
        int,
        typer.Option(
            min=2,
            help="Simulated campaigns for Tables 2 to 4, Figures 6 to 8 and the claims.",
        ),
    ] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated noise.")] = 1,
    output_format: Annotated[
        ReproductionFormat,
        typer.Option("--format", help="One Markdown page, or a CSV file for each item."),
    ] = ReproductionFormat.md,
    force: Annotated[bool, typer.Option(help="Replace existing files.")] = False,
) -> None:
    """Reproduce the paper's tables, figures and claims by simulation, next to the printed numbers.

    Simulated logs pass the filter, gate and estimators of run. Numbers are means over many trials
    with 95 % intervals and, where it is known, the Cramér–Rao bound; sentences say where they
    differ from the paper's, and why.
    """
    from estimators.errors import OutputError, suggest_choice
    from recordings.paper.paper_items import ITEMS
    from recordings.paper.paper_page import require_writable_reproduction_folder, write_reproduction
    from replay.commands.progress_bar import StageProgress
    from replay.paper.reproduce_paper import Reproduction

    names = [item.name for item in ITEMS]
    for name in items or []:
        if name not in names:
            raise OutputError(f"reproduce {name}: no such item; {suggest_choice(name, names)}")
    wanted = [item for item in ITEMS if item.name in (items or names)]
    require_writable_reproduction_folder(wanted, output, output_format, overwrites=force)
    reproduction = Reproduction(wanted, windows=trials, campaigns=campaigns, seed=seed)
    with StageProgress(len(reproduction.repetitions)) as stages:
        found = reproduction.compute_paper_items(stages.begin_stage)
    about = (
        f"By `payscope reproduce --trials {trials} --campaigns {campaigns} --seed {seed}`: "
        "simulated with one machine model, replayed with the filter, gate and estimators that "
        "replay a log. Intervals are of 95 %: bootstrap of a root mean square, Student's of a mean "
        "over campaigns."
    )
    for path in write_reproduction(found, output, output_format, about, overwrites=force):
        typer.echo(str(path))
