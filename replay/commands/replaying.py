"""Replaying logs from the command line: opening, progress, recording, the printed answer."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from analysis.answer import answer
from estimators.errors import LogError
from recordings import write_recording
from recordings.output import check_output
from replay.commands.progress import Stages
from replay.machine import load_machine
from replay.pipeline import run
from replay.readers import TimeAxis, open_log


def replay_logs(
    logs: Sequence[Path],
    machine_file: Path,
    output: Path | None,
    overrides: Sequence[str] = (),
    *,
    strict: bool = False,
    force: bool = False,
    timing: bool = False,
) -> dict[str, Any]:
    """Replay logs in one time line and record the run; the answer with the recording's path.

    Raises:
        PayscopeError: whatever is wrong with the input, before anything is written.
    """
    machine = load_machine(machine_file, overrides)
    if output is not None:
        check_output(output, force=force)
    section = machine.log
    time = TimeAxis(section.time, section.time_unit) if section.time else None
    with ExitStack() as stack, Stages(timing=timing) as stages:
        opened = [stack.enter_context(open_log(path, time=time)) for path in logs]
        result = run(opened, machine, stages.begin)
        if strict and result.provenance.losses:
            first = result.provenance.losses[0]
            raise LogError(
                f"{first.source}: {first.topic + ': ' if first.topic else ''}{first.what} "
                f"({len(result.provenance.losses)} losses in all; leave out --strict to accept)"
            )
        if output is not None:
            stages.begin("record")
            write_recording(result, output, force=force)
    return {**answer(result), "recording": str(output) if output else None}


def print_answer(answer: dict[str, Any], *, as_json: bool) -> None:
    """Print an answer: JSON, or a table of masses and the verdict, on stdout."""
    if as_json:
        from replay.commands.printing import print_json

        print_json(answer)
        return
    console = Console(highlight=False)
    weighs = answer["verdict"]["can_weigh"]
    if weighs:
        console.print(_masses(answer))
    for loss in answer["losses"]:
        console.print(f"lost: {loss['source']} {loss['topic']}: {loss['what']}", markup=False)
    for note in answer["notes"]:
        console.print(f"note: {note}", markup=False)
    failed = [check for check in answer["verdict"]["checks"] if check["passed"] is False]
    share = answer["accepted_share"]
    if weighs:
        console.print(f"This log can weigh: every check passed, {share:.0%} of it was used.")
    else:
        console.print("This log cannot weigh, so the mass is withheld. Failed:")
    console.print(_checks(failed if not weighs else answer["verdict"]["checks"]))
    if answer["recording"]:
        console.print(f"recording: {answer['recording']}", markup=False, soft_wrap=True)


def _masses(answer: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("method", "mass kg", "± kg (1σ)", "payload kg"):
        table.add_column(title, justify="left" if title == "method" else "right")
    for method, mass in answer["mass_kg"].items():
        std = answer["mass_std_kg"][method]
        payload = answer["payload_kg"][method]
        table.add_row(
            method,
            *("–" if x is None else f"{x:,.2f}" for x in (mass, std, payload)),
        )
    return table


def _checks(checks: Sequence[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("check")
    table.add_column("value", justify="right")
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("")
    table.add_column("meaning", overflow="fold")
    for check in checks:
        low, high = check["minimum"], check["maximum"]
        limit = " … ".join(f"{x:g}" for x in (low, high) if x is not None)
        if high is None:
            limit = f"≥ {limit}"
        elif low is None:
            limit = f"≤ {limit}"
        state = {True: "ok", False: "[red]failed[/]", None: "n/a"}[check["passed"]]
        value = check["value"]
        table.add_row(
            check["check"],
            "–" if value is None else f"{value:.3g}",
            limit,
            state,
            check["meaning"],
        )
    return table
