"""`payscope run`: the main job."""

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.commands.options import (
    Calibration,
    RequireSigned,
    SignerKey,
    asked_calibration,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rich.console import Console
    from rich.table import Table

    from analysis.answer import Answer, AnswerRow
    from analysis.check import Check, Verdict
    from analysis.comparison import Changed
    from replay.replay_logs import RecordTo


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
        typer.Option("--goal", metavar="KG", min=1e-3, help="Say what would reach ± KG."),
    ] = None,
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Replay logs as one time line and estimate the mass; judge whether these logs can weigh.

    Exit status 1 if they cannot: the mass is withheld and the failed checks are listed. With
    --watch each change of the machine file is replayed, into the open viewer with --live; a fault
    in the file is one line, and ctrl-C ends with status 0.
    """
    from replay.commands.printing import print_json
    from replay.commands.progress import Stages
    from replay.replay_logs import STEPS, RecordTo, replay_logs

    if live and output is None:
        raise typer.BadParameter("--live shows a recording: name it with -o")
    if goal is not None and as_json:
        raise typer.BadParameter("--goal is said in words: leave out --json")
    settings = [*(overrides or []), *_empty(empty)]
    asked = asked_calibration(calibration, key, signed=require_signed)

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
            print_answer(answer, goal)

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
    from replay.commands.printing import value_text
    from replay.watch import watch

    def on_answer(answer: "Answer", changed: "list[Changed]") -> None:
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


_OF_MASS = {
    "mass kg": ("mass_kg", "mass_std_kg"),
    "payload kg": ("payload_kg", None),
    "friction N·s/m": ("friction_x_N_s_m", "friction_x_std_N_s_m"),
    "Coulomb N": ("coulomb_x_N", "coulomb_x_std_N"),
}
_OF_INERTIA = {
    "yaw inertia kg·m²": ("inertia_z_kg_m2", "inertia_z_std_kg_m2"),
    "turning N·m·s": ("friction_z_N_m_s", "friction_z_std_N_m_s"),
}


def _empty(span: str | None) -> list[str]:
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
            f"'{span}' is no stretch: FROM:TO in seconds from the start, such as 0:60",
            param_hint="--empty",
        )
    return [f"settings.loads.empty_from_s={first!r}", f"settings.loads.empty_to_s={last!r}"]


def print_answer(answer: "Answer", goal: float | None = None) -> None:
    """Print a table of masses, and the verdict check by check, on stdout."""
    from recordings.planar_text import planar_lines
    from recordings.worth_text import shift_lines
    from replay.commands.printing import console, print_line, print_table

    screen, verdict = console(), answer.verdict
    if verdict.can_weigh:
        _print_worth(screen, answer)
    if goal is not None:
        from recordings.worth_text import goal_lines

        for line in goal_lines(answer, goal):
            print_line(screen, line)
    if len(answer.loads) > 1 and not verdict.tells_inertia:
        print_line(screen, "the paper's methods give one mass a log, and are not shown")
    elif verdict.can_weigh or verdict.tells_inertia:
        print_line(
            screen,
            "by method (joint: the answer; the others' ± is statistical only; –: withheld)",
        )
        for row in answer.rows:
            print_table(screen, _masses(row, verdict))
    for line in (
        *shift_lines(answer),
        *planar_lines(answer.planar, answer.planar_budget),
        *(f"lost: {loss}" for loss in answer.losses),
        *(f"note: {note}" for note in answer.notes),
    ):
        print_line(screen, line)
    _print_verdict(screen, answer)
    if answer.fingerprint:
        print_line(screen, f"fingerprint: {answer.fingerprint}")
    if answer.recording:
        print_line(screen, f"recording: {answer.recording}")


def _print_verdict(screen: "Console", answer: "Answer") -> None:
    """Whether the log can weigh, check by check, and what would mend what failed."""
    from replay.commands.printing import print_line, print_table

    verdict = answer.verdict
    failed = (*verdict.failed("mass"), *verdict.failed("inertia"))
    if verdict.can_weigh:
        which = "no check of the mass forbids it" if failed else "no check forbids it"
        share = f"{answer.accepted_share:.0%}"
        screen.print(f"This log can weigh: {which}, {share} of it was used.")
        for check in verdict.remarks:
            print_line(screen, f"{_CONSEQUENCES[check.consequence]}: {_remark(check)}")
    else:
        screen.print("This log cannot weigh, so the mass is withheld. Failed:")
    print_table(screen, _checks(verdict.checks if verdict.can_weigh else failed))
    for check in failed:
        if check.remedy and check.value is not None:
            print_line(screen, f"{check.check}: {check.remedy}")
    if verdict.judges_spins and not verdict.tells_inertia:
        screen.print(
            "No inertia estimate: the checks of the spins, or of the force's sign, failed."
        )


_CONSEQUENCES = {
    "widen": "taken into account",
    "method": "methods not shown",
    "tell": "note",
}


def _remark(check: "Check") -> str:
    value = "" if check.value is None else f" is {check.value:.3g} ({check.limit})"
    return f"{check.check}{value}, {check.meaning}"


def _print_worth(screen: "Console", answer: "Answer") -> None:
    """The answer, and where its uncertainty comes from."""
    from recordings.worth_text import (
        advice,
        budget_rows,
        load_heads,
        load_rows,
        main_load,
        worth_lines,
    )
    from replay.commands.printing import plain_table, print_line, print_table

    for line in worth_lines(answer):
        print_line(screen, line)
    several = len(answer.loads) > 1
    if several:
        heads = load_heads(answer)
        loads = plain_table(*heads[:-1])
        loads.add_column(heads[-1], overflow="fold")
        for load in load_rows(answer):
            loads.add_row(*load)
        print_table(screen, loads)
    rows = budget_rows(answer)
    if rows:
        of = f" (mass of load {main_load(answer)})" if several else ""
        table = plain_table(f"uncertainty from{of}", "kind", "u kg")
        table.add_column("share of the variance")
        table.add_column("shrinks with", overflow="fold")
        for row in rows:
            table.add_row(*row)
        print_table(screen, table)
    most = advice(answer)
    if most:
        print_line(screen, most)
    screen.print()


def _masses(row: "AnswerRow", verdict: "Verdict") -> "Table":
    from replay.commands.printing import plain_table

    columns = {
        **(_OF_MASS if verdict.can_weigh else {}),
        **(_OF_INERTIA if verdict.tells_inertia else {}),
    }
    shown = {title: names for title, names in columns.items() if names[0] in row.quantities}
    table = plain_table("method", *shown)
    for method in row.methods:
        table.add_row(method, *(_number(row, method, *names) for names in shown.values()))
    return table


def _number(row: "AnswerRow", method: str, name: str, std_name: str | None) -> str:
    value, std = row.value(name, method), row.value(std_name, method) if std_name else None
    if value is None:
        return "–"
    return f"{value:,.2f}" + ("" if std is None else f" ± {std:.2f}")


def _checks(checks: "Sequence[Check]") -> "Table":
    from recordings.wording import outcome
    from replay.commands.printing import plain_table

    table = plain_table("check", "value", "limit")
    table.add_column("")
    table.add_column("meaning", overflow="fold")
    for check in checks:
        value = "–" if check.value is None else f"{check.value:.3g}"
        state = outcome(check, passed="ok", failed="[red]failed[/]", absent="n/a")
        table.add_row(check.check, value, check.limit, state, check.meaning)
    return table
