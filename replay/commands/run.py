"""`payscope run`: the main job."""

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.commands.common_options import Calibration, RequireSigned, SignerKey, read_calibration

if TYPE_CHECKING:
    from collections.abc import Callable

    from analysis.compare.run_comparison import ValueChange
    from analysis.model.answer import Answer
    from replay.runs.run_logs import RecordTo


def command(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs (.bag, .mcap, rosbag2, .db3, .csv, .parquet, .rrd).")
    ],
    machine: Annotated[Path, typer.Option("-m", "--machine", help="The machine file.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="The recording to write (.rrd).")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    timing: Annotated[bool, typer.Option(help="Print the duration of each stage.")] = False,
    strict: Annotated[bool, typer.Option(help="Refuse a log with any loss.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Show the recording in the viewer while it is written.")
    ] = False,
    watch: Annotated[
        bool,
        typer.Option("--watch", help="Replay whenever the machine file changes, until ctrl-C."),
    ] = False,
    force: Annotated[bool, typer.Option(help="Replace an existing recording.")] = False,
    empty: Annotated[
        str | None,
        typer.Option("--empty", metavar="FROM:TO", help="Seconds in which it carried nothing."),
    ] = None,
    goal: Annotated[
        float | None,
        typer.Option(
            "--goal", metavar="KG", min=1e-3, help="Print how many more starts would reach ± KG."
        ),
    ] = None,
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    verbose: Annotated[
        int,
        typer.Option(
            "-v", "--verbose", count=True, help="Print budget and methods; -vv: every check."
        ),
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Replay logs as one time line and estimate the mass; judge whether these logs can weigh.

    Exit status 1 if they cannot: the mass is withheld and the failed checks are listed. With
    --watch each change of the machine file is replayed, into the open viewer with --live; a fault
    in the file is one line, and ctrl-C ends with status 0.
    """
    from replay.commands.answer_text import print_answer
    from replay.commands.print_tables import print_json
    from replay.commands.progress_bar import Stages
    from replay.runs.run_logs import STEPS, RecordTo, replay_logs

    if live and output is None:
        raise typer.BadParameter("--live shows a recording: name it with -o")
    if goal is not None and as_json:
        raise typer.BadParameter("--goal prints text: leave out --json")
    settings = [*(overrides or []), *_empty_span_settings(empty)]
    asked = read_calibration(calibration, key, signed=require_signed)

    def replay(to: RecordTo) -> "Answer":
        with Stages(len(STEPS), timing=timing) as stages:
            return replay_logs(
                logs,
                machine,
                to,
                settings,
                strict=strict,
                calibration=asked,
                on_stage=stages.begin,
            )

    def show(answer: "Answer") -> None:
        if as_json:
            print_json(answer.to_dict())
        else:
            print_answer(answer, goal, verbose)

    to = RecordTo(output, force, live)
    if watch:
        _watch(machine, to, settings, replay, show)
        return
    answer = replay(to)
    show(answer)
    if not answer.verdict.can_weigh:
        raise typer.Exit(1)


def _watch(
    machine: Path,
    to: "RecordTo",
    settings: list[str],
    replay: "Callable[[RecordTo], Answer]",
    show: "Callable[[Answer], None]",
) -> None:
    """Replay after each change, with a line of what changed, until interrupted."""
    from estimators.errors import PayscopeError, one_line
    from replay.commands.print_tables import value_text
    from replay.runs.watch_machine_file import watch

    def on_answer(answer: "Answer", changed: "list[ValueChange]") -> None:
        if changed:
            said = ", ".join(
                f"{each.name} {value_text(each.a)} → {value_text(each.b)}" for each in changed
            )
            typer.echo(one_line(f"{machine} changed: {said}"), err=True)
        show(answer)
        sys.stdout.flush()
        typer.echo(f"watching {machine}; ctrl-C ends", err=True)

    def on_error(error: PayscopeError) -> None:
        typer.echo(f"payscope: {one_line(str(error))}", err=True)

    # interrupted is how it ends
    with suppress(KeyboardInterrupt):
        watch(machine, to, settings, replay, on_answer, on_error)


def _empty_span_settings(span: str | None) -> list[str]:
    """`FROM:TO` as settings."""
    if span is None:
        return []
    begin, colon, end = span.partition(":")
    try:
        first, last = float(begin), float(end)
    except ValueError:
        first = last = 0.0
    if not colon or not first < last:
        raise typer.BadParameter(
            f"'{span}' is not a time span; use FROM:TO in seconds from the start, such as 0:60",
            param_hint="--empty",
        )
    return [f"settings.loads.empty_from_s={first!r}", f"settings.loads.empty_to_s={last!r}"]
