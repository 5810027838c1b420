"""`payscope run`: the main job."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from analysis.answer import Answer, AnswerRow
    from analysis.check import Check, Verdict


def command(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs (.bag, .mcap, rosbag2, .db3, .csv, .parquet).")
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
    force: Annotated[bool, typer.Option(help="Replace an existing recording.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Replay logs as one time line and estimate the mass; judge whether these logs can weigh.

    Exit status 1 if they cannot: the mass is withheld and the failed checks are listed.
    """
    from replay.commands.printing import print_json
    from replay.commands.progress import Stages
    from replay.replay_logs import STEPS, replay_logs

    if live and output is None:
        raise typer.BadParameter("--live shows a recording: name it with -o")
    with Stages(len(STEPS), timing=timing) as stages:
        answer = replay_logs(
            logs,
            machine,
            output,
            overrides or [],
            strict=strict,
            force=force,
            live=live,
            on_stage=stages.begin,
        )
    if as_json:
        print_json(answer.to_dict())
    else:
        print_answer(answer)
    if not answer.verdict.can_weigh:
        raise typer.Exit(1)


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


def print_answer(answer: "Answer") -> None:
    """Print a table of masses, and the verdict check by check, on stdout."""
    from recordings.planar_text import planar_lines
    from replay.commands.printing import console, print_line, print_table

    screen, verdict = console(), answer.verdict
    if verdict.can_weigh or verdict.tells_inertia:
        for row in answer.rows:
            print_table(screen, _masses(row, verdict))
    for line in planar_lines(answer.planar):
        screen.print(line, markup=False)
    for loss in answer.losses:
        print_line(screen, f"lost: {loss}")
    for note in answer.notes:
        print_line(screen, f"note: {note}")
    failed = (*verdict.failed("mass"), *verdict.failed("inertia"))
    if verdict.can_weigh:
        which = "every check of the mass" if failed else "every check"
        share = f"{answer.accepted_share:.0%}"
        screen.print(f"This log can weigh: {which} passed, {share} of it was used.")
    else:
        screen.print("This log cannot weigh, so the mass is withheld. Failed:")
    print_table(screen, _checks(verdict.checks if verdict.can_weigh else failed))
    if verdict.judges_spins and not verdict.tells_inertia:
        screen.print(
            "No inertia estimate: the checks of the spins, or of the force's sign, failed."
        )
    if answer.fingerprint:
        print_line(screen, f"fingerprint: {answer.fingerprint}")
    if answer.recording:
        print_line(screen, f"recording: {answer.recording}")


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
    from replay.commands.printing import plain_table

    table = plain_table("check", "value", "limit")
    table.add_column("")
    table.add_column("meaning", overflow="fold")
    state = {True: "ok", False: "[red]failed[/]", None: "n/a"}
    for check in checks:
        value = "–" if check.value is None else f"{check.value:.3g}"
        table.add_row(check.check, value, check.limit, state[check.passed], check.meaning)
    return table
