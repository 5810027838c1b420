"""Replaying logs from the command line: opening, progress, recording, the printed answer."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.table import Table

from analysis.answer import answer
from analysis.fingerprint import Fingerprint
from analysis.run import Loss
from estimators.errors import DataError, LogError
from recordings import check_recording, write_recording
from recordings.planar_text import planar_lines
from recordings.viewer import start_viewer
from replay.commands.printing import console, plain_table, print_json, print_line, print_table
from replay.commands.progress import Stages
from replay.machine import load_machine, time_axis
from replay.pipeline import run
from replay.readers import open_log


def replay_logs(
    logs: Sequence[Path],
    machine_file: Path,
    output: Path | None,
    overrides: Sequence[str] = (),
    *,
    strict: bool = False,
    force: bool = False,
    timing: bool = False,
    live: bool = False,
) -> dict[str, Any]:
    """Replay logs in one time line and record the run; the answer with the recording's path.

    Raises:
        PayscopeError: whatever is wrong with the input, before anything is written.
    """
    machine = load_machine(machine_file, overrides)
    if output is not None:
        check_recording(output, force=force)
    # before the work: without a screen there is nothing to wait for
    viewer = start_viewer() if live else None
    with ExitStack() as stack, Stages(timing=timing) as stages:
        stages.begin("open")
        opened = [stack.enter_context(open_log(path, time=time_axis(machine))) for path in logs]
        try:
            result = run(opened, machine, stages.begin)
        except DataError as error:
            names = ", ".join(map(str, logs))
            raise DataError(f"{names} with {machine_file}: {error}") from None
        if strict and result.provenance.losses:
            first, *more = result.provenance.losses
            others = f"and {len(more)} more; " if more else ""
            raise LogError(f"{first} ({others}leave out --strict to accept)")
        if output is not None:
            stages.begin("record")
            write_recording(result, output, force=force, viewer=viewer)
    return {**answer(result), "recording": str(output) if output else None}


def print_answer(answer: dict[str, Any], *, as_json: bool) -> None:
    """Print an answer: JSON, or a table of masses and the verdict, on stdout."""
    if as_json:
        print_json(answer)
        return
    screen = console()
    weighs = answer["verdict"]["can_weigh"]
    if weighs or answer["verdict"]["tells_inertia"]:
        print_table(screen, _totals(answer))
    for line in planar_lines(answer["planar"]):
        screen.print(line, markup=False)
    for loss in answer["losses"]:
        print_line(screen, f"lost: {Loss(**loss)}")
    for note in answer["notes"]:
        print_line(screen, f"note: {note}")
    checks = answer["verdict"]["checks"]
    failed = [c for c in checks if c["passed"] is False and c["about"] == "mass"]
    lost = [c for c in checks if c["passed"] is False and c["about"] == "inertia"]
    share = answer["accepted_share"]
    if weighs:
        which = "every check of the mass" if lost else "every check"
        screen.print(f"This log can weigh: {which} passed, {share:.0%} of it was used.")
    else:
        screen.print("This log cannot weigh, so the mass is withheld. Failed:")
    print_table(screen, _checks([*failed, *lost] if not weighs else checks))
    spins = any(check["about"] == "inertia" for check in checks)
    if spins and not answer["verdict"]["tells_inertia"]:
        screen.print("The spins tell no inertia: it is withheld.")
    if taken := answer.get("fingerprint"):
        print_line(screen, f"fingerprint: {Fingerprint(**taken)}")
    if answer["recording"]:
        print_line(screen, f"recording: {answer['recording']}")


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


def _totals(answer: dict[str, Any]) -> Table:
    judged = answer["verdict"]
    columns = {
        **(_OF_MASS if judged["can_weigh"] else {}),
        **(_OF_INERTIA if judged["tells_inertia"] else {}),
    }
    shown = {title: names for title, names in columns.items() if names[0] in answer}
    table = plain_table("method", *shown)
    for method in answer["mass_kg"]:
        table.add_row(method, *(_number(answer, method, *names) for names in shown.values()))
    return table


def _number(answer: dict[str, Any], method: str, name: str, std_name: str | None) -> str:
    value, std = answer[name][method], answer[std_name][method] if std_name else None
    if value is None:
        return "–"
    return f"{value:,.2f}" + ("" if std is None else f" ± {std:.2f}")


def _checks(checks: Sequence[dict[str, Any]]) -> Table:
    table = plain_table("check", "value", "limit")
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
