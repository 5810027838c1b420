"""`payscope explain`: say why an estimate is bad, and which settings would correct it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from replay.commands.screen_limits import LIMITS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import Console

    from analysis.explain import Explanation
    from analysis.model.answer import Answer
    from replay.explain.try_proposals import CorrectedMachine


def command(
    recording: Annotated[
        Path, typer.Argument(help="A recording (.rrd), or a log with its machine file.")
    ],
    at_s: Annotated[
        float | None, typer.Option("--at", help="Explain this second instead of the whole run.")
    ] = None,
    machine: Annotated[
        Path | None, typer.Option("-m", "--machine", help="Replay with this machine file.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            help="Picture (.png, .pdf, .svg); with --apply, the machine file (.toml).",
        ),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option(
            "--apply",
            help="Write the machine file of -m with the proposals that improve the mass.",
        ),
    ] = False,
    force: Annotated[bool, typer.Option(help="Replace existing files.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Explain the mass of a run: detected causes, the gate, and undetermined parameters.

    Each cause comes with its measurement, its effect on the mass, the key of the machine file, and
    the causes that cannot be distinguished from it in this log. With --apply -o mended.toml the
    machine file is written with the proposals that improve the mass, and the log is replayed with
    it. Exit status 1 if no proposal improves the mass.
    """
    from replay.commands.print_tables import print_json
    from replay.commands.progress_bar import StageProgress
    from replay.explain.explain_run import ExplainRequest, explain_run_and_correct_machine

    picture, corrected_file = split_into_picture_and_machine_file(
        output or [], is_machine_file_wanted=apply
    )
    if overrides and machine is None:
        raise typer.BadParameter("--set changes a machine file; give the file with -m")
    asked = ExplainRequest(
        recording, machine, tuple(overrides or ()), at_s, picture, corrected_file, overwrites=force
    )
    with StageProgress(LIMITS.replay_stages) as stages:
        explained, corrected = explain_run_and_correct_machine(asked, stages.begin_stage)
    if as_json:
        corrected_machine_entry = (
            {} if corrected is None else {"mended": _convert_corrected_machine_to_dict(corrected)}
        )
        print_json({**explained.to_dict(), **corrected_machine_entry})
    else:
        _print_explanation(explained, corrected, asked.picture)
    if corrected is not None and corrected.path is None:
        raise typer.Exit(1)


class ExplainOutputs(NamedTuple):
    """Picture and machine file that an explanation is written to; None for each not requested."""

    picture: Path | None
    machine_file: Path | None


def split_into_picture_and_machine_file(
    paths: list[Path], *, is_machine_file_wanted: bool
) -> ExplainOutputs:
    """Split the outputs into picture and machine file.

    Raises:
        BadParameter: two outputs of a kind, --apply without a .toml output, or a .toml output
            without --apply.
    """
    files = [path for path in paths if path.suffix == ".toml"]
    pictures = [path for path in paths if path.suffix != ".toml"]
    if len(files) > 1 or len(pictures) > 1:
        extra = ", ".join(map(str, files[1:] + pictures[1:]))
        raise typer.BadParameter(f"-o takes at most one picture and one .toml, not also {extra}")
    if is_machine_file_wanted and not files:
        raise typer.BadParameter(
            "--apply writes a machine file; name it, for example -o mended.toml"
        )
    if files and not is_machine_file_wanted:
        raise typer.BadParameter(
            f"{files[0]}: a machine file is only written with --apply; add it, or name a picture"
        )
    return ExplainOutputs(pictures[0] if pictures else None, files[0] if files else None)


def _convert_corrected_machine_to_dict(corrected_machine: "CorrectedMachine") -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "path": None if corrected_machine.path is None else str(corrected_machine.path),
        "changes": [asdict(each) for each in corrected_machine.changes],
        "taken_back": [asdict(each) for each in corrected_machine.rejected],
        "can_weigh": corrected_machine.after.verdict.can_weigh,
        "loads_before": [dict(row) for row in corrected_machine.before.loads],
        "loads": [dict(row) for row in corrected_machine.after.loads],
        "findings_left": [asdict(each) for each in corrected_machine.remaining],
    }


def _print_explanation(
    explanation: "Explanation",
    corrected_machine: "CorrectedMachine | None",
    picture_path: Path | None,
) -> None:
    from recordings.explain.explanation_view import (
        describe_answer_and_likeliest_cause,
        describe_mass_of_manoeuvre,
        iter_lines_of_determined_parameters,
        iter_lines_of_findings,
        iter_lines_of_gate_reasons,
    )
    from replay.commands.print_checks import print_failed_checks
    from replay.commands.print_tables import make_stdout_console, print_line

    screen = make_stdout_console()

    def print_part(title: str, lines: "Iterable[str]") -> None:
        listed = list(lines)
        if listed:
            screen.print(f"\n{title}", markup=False)
        for line in listed:
            print_line(screen, line)

    if corrected_machine is not None and corrected_machine.path is None:
        print_line(screen, "no proposal improves the mass, so no machine file was written")
    print_line(screen, describe_answer_and_likeliest_cause(explanation))
    failed = explanation.answer.verdict.list_withholding_checks("mass")
    if failed:
        screen.print("\nfailed checks:", markup=False)
        print_failed_checks(screen, failed)
    print_part("causes, the likeliest first:", iter_lines_of_findings(explanation))
    if explanation.manoeuvre is not None:
        print_part("its manoeuvre:", [describe_mass_of_manoeuvre(explanation.manoeuvre)])
    print_part(
        _format_worst_manoeuvres_title(explanation),
        map(describe_mass_of_manoeuvre, explanation.worst),
    )
    around = (
        "the gate around it:" if explanation.at_s is not None else "the gate, by share of time:"
    )
    print_part(around, iter_lines_of_gate_reasons(explanation))
    print_part("the motion:", iter_lines_of_determined_parameters(explanation.determined))
    if corrected_machine is not None:
        _print_corrected_machine(screen, corrected_machine)
    if picture_path is not None:
        screen.print()
        print_line(screen, f"picture: {picture_path}")


def _format_worst_manoeuvres_title(explanation: "Explanation") -> str:
    if any(each.deviations is not None for each in explanation.worst):
        return "manoeuvres farthest from their load:"
    if any(each.mass_kg is not None for each in explanation.worst):
        return "longest rejected manoeuvres:"
    return "longest manoeuvres without a mass:"


def _print_corrected_machine(console: "Console", corrected_machine: "CorrectedMachine") -> None:
    from recordings.report.finding_text import find_readable_cause_name
    from replay.commands.print_tables import format_setting_value, print_line

    console.print("\nproposed corrections, each tested by a replay:", markup=False)
    for each in corrected_machine.changes:
        claim = ""
        if each.change_kg is not None:
            claim = f", claimed {each.change_kg:+,.2f} ± {each.change_u_kg or 0.0:,.2f} kg"
        said = (
            f"{each.key} = {format_setting_value(each.value)} "
            f"({find_readable_cause_name(each.cause)}{claim})"
        )
        print_line(console, said)
    for tried in corrected_machine.rejected:
        key, cause = tried.proposal.key, find_readable_cause_name(tried.proposal.cause)
        print_line(console, f"not {key} ({cause}): {tried.why}")
    if corrected_machine.path is None:
        return
    before, after = (
        _format_mass_of_heaviest_load(corrected_machine.before),
        _format_mass_of_heaviest_load(corrected_machine.after),
    )
    print_line(console, f"mass: {before or 'withheld'} before, {after or 'withheld'} replayed")
    left = (
        ", ".join(find_readable_cause_name(each.cause) for each in corrected_machine.remaining)
        or "no cause"
    )
    print_line(console, f"remaining findings: {left}")
    print_line(console, f"machine file: {corrected_machine.path}")


def _format_mass_of_heaviest_load(answer: "Answer") -> str:
    """Format the mass of the heaviest or only load; empty if it is withheld."""
    from recordings.report.number_text import format_plus_minus

    if not answer.verdict.can_weigh:
        return ""
    known = [load for load in answer.loads if load["mass_kg"] is not None]
    if not known:
        return ""
    most = max(known, key=lambda load: load["mass_kg"])
    which = f" (load {most['load_id']}, the heaviest)" if len(known) > 1 else ""
    return f"{format_plus_minus(most['mass_kg'], most['u_kg'])} kg{which}"
