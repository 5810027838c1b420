"""`payscope excite`: design an excitation, and print the predicted errors of each waveform."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType

    from analysis.excitation import ExcitationDesign

_TITLES: Final = {"mass_kg": "mass kg", "inertia_z_kg_m2": "Izz kg·m²", "com_x_m": "com x m"}
_DIGITS: Final = {"mass_kg": 1, "inertia_z_kg_m2": 1, "com_x_m": 4}


def command(
    scenario: Annotated[
        Path | None,
        typer.Argument(help="A scenario file (TOML); without one, the paper's machine."),
    ] = None,
    motion: Annotated[
        Literal["straight", "spin", "joint"],
        typer.Option(help="Drive with a force, a yaw torque, or both at once."),
    ] = "straight",
    accuracy: Annotated[
        str, typer.Option(help="Wanted error of the mass (in a spin, yaw inertia), as 1% or 0.01.")
    ] = "1%",
    window: Annotated[
        float | None, typer.Option(help="Window in s, between T and 3 T; 2 T by default.")
    ] = None,
    yard: Annotated[
        float | None, typer.Option(min=0.0, help="Greatest distance in m from the start.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the scenario; repeatable."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Write the best waveform as a scenario file for simulate."
        ),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the design as JSON.")] = False,
) -> None:
    """Design an excitation: compare waveforms by the error that they leave in the estimates.

    Period and window follow from the machine's response time T. Each waveform drives the
    simulated machine; the table predicts the errors of least squares over the window that
    determines the parameters least. Exit status 1 when no waveform reaches the accuracy.
    """
    from analysis.excitation import design_excitation
    from recordings.report.atomic_output import refuse_input_as_output, require_writable_output
    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.simulation.scenario_file import load_scenario_file, write_scenario_file

    wanted = _parse_percent_or_fraction(accuracy)
    if output:
        refuse_input_as_output(output, [scenario] if scenario else [])
        require_writable_output(output, overwrites=force)
    base = load_scenario_file(scenario, overrides or [])
    made = design_excitation(base, motion, wanted, window, yard)
    if as_json:
        print_json(made.to_dict())
    else:
        make_stdout_console().print(_render_excitation_design(made))
    if output and made.best:
        write_scenario_file(made.to_scenario(base), output, overwrites=force)
        typer.echo(str(output), err=as_json)
    if not made.is_accuracy_reached:
        raise typer.Exit(1)


def _parse_percent_or_fraction(text: str) -> float:
    """Parse `1%` or `0.01` as 0.01."""
    number, percent, rest = text.strip().partition("%")
    try:
        value = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        value = 0.0
    if rest or not 0.0 < value < 1.0:
        raise typer.BadParameter(f"--accuracy {text}: write it as 1% or 0.01, below 100%")
    return value


def _render_excitation_design(excitation_design: ExcitationDesign) -> RenderableType:
    """Render table and notes of a design for the terminal."""
    from rich.console import Group

    from replay.commands.print_tables import make_plain_table

    names = list(excitation_design.scores[0].predictions)
    titles = [text for name in names for text in (f"± {_TITLES[name]}", "bias")]
    table = make_plain_table(
        "waveform", *titles, "error", "rank", "condition", "SNR", "needs", "peak m/s", "reach m", ""
    )
    for score in excitation_design.scores:
        numbers = [
            f"{value:.{_DIGITS[name]}f}"
            for name, each in score.predictions.items()
            for value in (each.predicted_error_std, each.bias)
        ]
        table.add_row(
            f"{score.waveform}, {score.ways}",
            *numbers,
            f"{score.relative_error:.2%}",
            str(score.rank),
            f"{score.condition:,.0f}",
            f"{score.snr:.1f}",
            "–" if score.snr_needed is None else f"{score.snr_needed:.1f}",
            f"{score.peak_speed_m_s:.2f}",
            f"{score.reach_m:.1f}",
            "best" if score is excitation_design.best else "",
        )
    return Group(
        *_describe_design_timing(excitation_design),
        "",
        table,
        "",
        _describe_design_verdict(excitation_design),
    )


def _describe_design_timing(excitation_design: ExcitationDesign) -> list[str]:
    periods = {
        "force": excitation_design.scores[0].manoeuvre.force,
        "torque": excitation_design.scores[0].manoeuvre.torque,
    }
    lines = [
        f"{axis}: response time T = {seconds:.2f} s, period {wave.period_s:.2f} s"
        for axis, seconds in excitation_design.response_s.items()
        if (wave := periods[axis]) is not None
    ]
    return [*lines, f"window {excitation_design.window_s:.2f} s"]


def _describe_design_verdict(excitation_design: ExcitationDesign) -> str:
    best, wanted = excitation_design.best, f"{excitation_design.accuracy:.3g}"
    if best is None:
        return "No waveform stays within the yard; give a longer --yard."
    name, error = f"{best.waveform}, {best.ways}", f"{best.relative_error:.2g}"
    if excitation_design.is_accuracy_reached:
        return f"The accuracy of {wanted} is reached: {name}, has {error}."
    return f"No waveform reaches the accuracy of {wanted}: the best, {name}, has {error}."
