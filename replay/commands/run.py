"""`payscope run`: replay and weigh; a dozen lines of answer, more with -v, all checks with -vv."""

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from replay.commands import print_tables
from replay.commands.common_options import (
    Calibration,
    Logs,
    RequireSigned,
    SignerKey,
    make_calibration_request,
)
from replay.commands.print_checks import make_table_of_checks, print_remedies_with_checks
from replay.commands.print_tables import make_plain_table, print_line, print_table_uncut
from replay.commands.screen_limits import LIMITS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rich.console import Console
    from rich.table import Table

    from analysis.compare.run_comparison import ValueChange
    from analysis.model.answer import Answer, AnswerRow
    from analysis.model.verdict import Verdict
    from replay.runs.run_logs import RecordingOutput

_OF_MASS: Final = {
    "mass kg": ("mass_kg", "mass_std_kg"),
    "payload kg": ("payload_kg", None),
    "friction N·s/m": ("friction_x_N_s_m", "friction_x_std_N_s_m"),
    "Coulomb N": ("coulomb_x_N", "coulomb_x_std_N"),
}
_OF_INERTIA: Final = {
    "yaw inertia kg·m²": ("inertia_z_kg_m2", "inertia_z_std_kg_m2"),
    "turning N·m·s": ("friction_z_N_m_s", "friction_z_std_N_m_s"),
}


def command(
    logs: Logs,
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
        typer.Option(
            "--empty",
            metavar="FROM:TO",
            help="Time span in which the machine was empty, in seconds.",
        ),
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
            "-v",
            "--verbose",
            count=True,
            help="Print the uncertainty budget and the methods; -vv: every check.",
        ),
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Replay logs as one time line and estimate the mass; judge whether these logs can weigh.

    Exit status 1 if they cannot: the mass is withheld and the failed checks are listed. With
    --watch each change of the machine file is replayed, into the open viewer with --live; a fault
    in the file is one line, and ctrl-C ends with status 0.
    """
    from replay.commands.print_tables import print_json
    from replay.commands.progress_bar import StageProgress
    from replay.runs.run_logs import STEPS, RecordingOutput, replay_and_record_logs

    if live and output is None:
        raise typer.BadParameter("--live shows the recording while it is written; name it with -o")
    if goal is not None and as_json:
        raise typer.BadParameter("--goal prints text only; leave out --json")
    settings = [*(overrides or []), *_make_empty_span_overrides(empty)]
    asked = make_calibration_request(calibration, key, is_signature_required=require_signed)

    def replay_to(to: RecordingOutput) -> "Answer":
        with StageProgress(len(STEPS), prints_stage_times=timing) as stages:
            return replay_and_record_logs(
                logs,
                machine,
                to,
                settings,
                strict=strict,
                calibration=asked,
                on_stage=stages.begin_stage,
            )

    def show_answer(answer: "Answer") -> None:
        if as_json:
            print_json(answer.to_dict())
        else:
            print_answer(answer, goal, verbose)

    to = RecordingOutput(output, force, live)
    if watch:
        replay_on_machine_file_changes(machine, to, settings, replay_to, show_answer)
        return
    answer = replay_to(to)
    show_answer(answer)
    if not answer.verdict.can_weigh:
        raise typer.Exit(1)


def replay_on_machine_file_changes(
    machine_file: Path,
    recording_path: "RecordingOutput",
    overrides: list[str],
    replay_logs: "Callable[[RecordingOutput], Answer]",
    print_answer: "Callable[[Answer], None]",
) -> None:
    """Replay after each change of the machine file and print the change, until interrupted."""
    from estimators.errors import PayscopeError, join_to_one_line
    from replay.commands.print_tables import format_setting_value
    from replay.runs.run_logs import watch_machine_file

    def print_changed_answer(answer: "Answer", changed: "list[ValueChange]") -> None:
        if changed:
            said = ", ".join(
                f"{each.name} {format_setting_value(each.a)} → {format_setting_value(each.b)}"
                for each in changed
            )
            typer.echo(join_to_one_line(f"{machine_file} changed: {said}"), err=True)
        print_answer(answer)
        sys.stdout.flush()
        typer.echo(f"watching {machine_file}; ctrl-C ends", err=True)

    def print_error(error: PayscopeError) -> None:
        typer.echo(f"payscope: {join_to_one_line(str(error))}", err=True)

    # watching ends by an interrupt
    with suppress(KeyboardInterrupt):
        watch_machine_file(
            machine_file, recording_path, overrides, replay_logs, print_changed_answer, print_error
        )


def _make_empty_span_overrides(empty_span: str | None) -> list[str]:
    """Make overrides for an empty span given as `FROM:TO`; none for None."""
    if empty_span is None:
        return []
    start, colon, end = empty_span.partition(":")
    try:
        first, last = float(start), float(end)
    except ValueError:
        first = last = 0.0
    if not colon or not first < last:
        raise typer.BadParameter(
            f"'{empty_span}' is not a time span; use FROM:TO in seconds "
            "from the start, such as 0:60",
            param_hint="--empty",
        )
    return [f"settings.loads.empty_from_s={first!r}", f"settings.loads.empty_to_s={last!r}"]


def print_answer(answer: "Answer", goal_u_kg: float | None = None, verbosity: int = 0) -> None:
    """Print the answer on stdout.

    Args:
        answer: answer of a run.
        goal_u_kg: standard uncertainty in kg, for which to print how many more starts would reach
            it; None prints nothing.
        verbosity: 1 adds budget, methods and omitted lines; 2 adds every check.
    """
    from recordings.report.answer_text import advise_to_reduce_uncertainty

    screen = print_tables.make_stdout_console()
    if answer.verdict.can_weigh:
        _print_masses_with_uncertainty(screen, answer, verbosity)
    else:
        print_weighing_verdict(screen, answer, verbosity)
    if most := advise_to_reduce_uncertainty(answer):
        print_line(screen, most)
    for line in iter_answer_notes(answer, goal_u_kg, verbosity):
        print_line(screen, line)
    if verbosity:
        _print_uncertainty_budget(screen, answer)
        _print_estimates_by_method(screen, answer)
    if answer.verdict.can_weigh:
        print_weighing_verdict(screen, answer, verbosity)
    if verbosity and answer.fingerprint:
        print_line(screen, f"fingerprint: {answer.fingerprint}")
    if answer.recording:
        print_line(screen, f"recording: {answer.recording}")
        print_line(screen, f"payscope explain {answer.recording} says why")
    if not verbosity:
        screen.print("-v: budget and methods; -vv: every check")


def _print_masses_with_uncertainty(console: "Console", answer: "Answer", verbosity: int) -> None:
    """Print masses and payloads, and the largest part of their uncertainty."""
    from recordings.report.answer_text import (
        describe_answer_as_lines,
        make_load_table_heads,
        make_load_table_rows,
    )

    for line in describe_answer_as_lines(answer, is_brief=not verbosity):
        print_line(console, line)
    if len(answer.loads) > 1:
        heads = make_load_table_heads(answer)
        loads = make_plain_table(*heads[:-1])
        loads.add_column(heads[-1], overflow="fold")
        rows = make_load_table_rows(answer)
        shown = rows if verbosity else rows[: LIMITS.answer_loads]
        for load in shown:
            loads.add_row(*load)
        print_table_uncut(console, loads)
        for line in _iter_omitted_count_line(len(rows) - len(shown), "load", "loads"):
            print_line(console, line)


def iter_answer_notes(answer: "Answer", goal_u_kg: float | None, verbosity: int) -> "Iterator[str]":
    """Yield further lines about the answer, the most important first."""
    from recordings.report.answer_text import (
        describe_manoeuvres_needed_for_goal,
        describe_shift_total,
    )
    from recordings.report.planar_text import describe_planar_fits

    if goal_u_kg is not None:
        yield from describe_manoeuvres_needed_for_goal(answer, goal_u_kg)
    if answer.verdict.can_estimate_inertia and not verbosity:
        yield from iter_yaw_inertia_lines(answer)
    yield from describe_shift_total(answer)
    yield from describe_planar_fits(answer.planar, answer.planar_budget)
    most_lines = len(answer.losses) + len(answer.notes) if verbosity else LIMITS.answer_lines
    yield from iter_lines_up_to_limit(
        [f"lost: {loss}" for loss in answer.losses], most_lines, "loss", "losses"
    )
    yield from iter_lines_up_to_limit(
        [f"note: {note}" for note in answer.notes], most_lines, "note", "notes"
    )
    yield from _iter_finding_lines(answer, verbosity)


def _iter_finding_lines(answer: "Answer", verbosity: int) -> "Iterator[str]":
    from recordings.report.finding_text import (
        can_fixing_change_mass,
        format_finding,
        make_findings_of_rows,
    )

    found = make_findings_of_rows(answer.findings)
    # the likeliest cause of a withheld mass comes before its consequences
    first = [] if answer.verdict.can_weigh else found[:1]
    shown = (
        found
        if verbosity
        else [e for e in found if e in first or can_fixing_change_mass(e)][: LIMITS.answer_lines]
    )
    yield from (f"finding: {format_finding(each)}" for each in shown)
    left = len(found) - len(shown)
    if left:
        yield f"{left} {'other finding' if left == 1 else 'other findings'} (-v)"


def iter_lines_up_to_limit(
    lines: "Sequence[str]", max_lines: int, singular: str, plural: str
) -> "Iterator[str]":
    """Yield the first `max_lines` lines, and a line that counts the others."""
    yield from lines[:max_lines]
    yield from _iter_omitted_count_line(len(lines) - max_lines, singular, plural)


def _iter_omitted_count_line(omitted_count: int, singular: str, plural: str) -> "Iterator[str]":
    """Yield one line with the number of lines that -v would add; nothing if it is 0."""
    if omitted_count > 0:
        yield f"{omitted_count} more {singular if omitted_count == 1 else plural} (-v)"


def iter_yaw_inertia_lines(answer: "Answer") -> "Iterator[str]":
    """Yield a line of text per row: its yaw inertia by the first method that estimated one."""
    from recordings.report.number_text import format_plus_minus

    for row in answer.rows:
        for method in row.methods:
            value = row.estimate("inertia_z_kg_m2", method)
            if value is not None:
                text = format_plus_minus(value, row.estimate("inertia_z_std_kg_m2", method))
                yield f"yaw inertia {text} kg·m² ({method})"
                break


def _print_uncertainty_budget(console: "Console", answer: "Answer") -> None:
    """Print a row for each source of uncertainty."""
    from recordings.report.answer_text import find_load_with_most_manoeuvres, make_uncertainty_rows

    rows = make_uncertainty_rows(answer) if answer.verdict.can_weigh else []
    if rows:
        of = (
            f" (mass of load {find_load_with_most_manoeuvres(answer)})"
            if len(answer.loads) > 1
            else ""
        )
        table = make_plain_table(f"uncertainty from{of}", "kind", "u kg")
        table.add_column("fraction of the variance")
        table.add_column("to reduce", overflow="fold")
        for row in rows:
            table.add_row(*row)
        print_table_uncut(console, table)


def _print_estimates_by_method(console: "Console", answer: "Answer") -> None:
    """Print the estimate of each method for the whole log."""
    verdict = answer.verdict
    if len(answer.loads) > 1 and not verdict.can_estimate_inertia:
        console.print("Other methods: not shown, since they give one mass per log")
    elif verdict.can_weigh or verdict.can_estimate_inertia:
        console.print("Other methods (statistical ± only; –: withheld)")
        for row in answer.rows:
            print_table_uncut(console, _make_table_of_method_estimates(row, verdict))


def print_weighing_verdict(console: "Console", answer: "Answer", verbosity: int) -> None:
    """Print whether the log can weigh: failed and near checks in full, the others counted."""
    verdict = answer.verdict
    failed = (*verdict.list_withholding_checks("mass"), *verdict.list_withholding_checks("inertia"))
    passed = sum(check.passed is True for check in verdict.checks)
    if verdict.can_weigh:
        share = f"{answer.accepted_share:.0%}"
        of = "checks of the mass" if failed else "checks"
        console.print(f"Log usable: {passed} {of} passed; {share} of the samples used.")
    else:
        console.print("Log not usable for weighing: the mass is withheld. Failed checks:")
    near = verdict.checks_near_limit if verdict.can_weigh else ()
    shown = (
        (*failed, *verdict.failed_checks_that_withhold_nothing, *near)
        if verdict.can_weigh
        else failed
    )
    if shown or verbosity > 1:
        print_table_uncut(console, make_table_of_checks(verdict.checks if verbosity > 1 else shown))
    print_remedies_with_checks(console, failed)
    if verdict.has_spins and not verdict.can_estimate_inertia:
        console.print(
            "No inertia estimate: the checks of the spins, or of the force's sign, failed."
        )


def _make_table_of_method_estimates(answer_row: "AnswerRow", verdict: "Verdict") -> "Table":
    columns = {
        **(_OF_MASS if verdict.can_weigh else {}),
        **(_OF_INERTIA if verdict.can_estimate_inertia else {}),
    }
    shown = {title: names for title, names in columns.items() if names[0] in answer_row.quantities}
    table = make_plain_table("method", *shown)
    for method in answer_row.methods:
        table.add_row(
            method,
            *(_format_method_estimate(answer_row, method, *names) for names in shown.values()),
        )
    return table


def _format_method_estimate(
    answer_row: "AnswerRow", method: str, quantity: str, std_quantity: str | None
) -> str:
    value, std = (
        answer_row.estimate(quantity, method),
        answer_row.estimate(std_quantity, method) if std_quantity else None,
    )
    if value is None:
        return "–"
    return f"{value:,.2f}" + ("" if std is None else f" ± {std:.2f}")
