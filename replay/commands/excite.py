"""`payscope excite`: which excitation tells most."""

from pathlib import Path
from typing import Annotated, Literal

import typer


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
        str, typer.Option(help="Wanted error of mass (yaw inertia), as 1% or 0.01.")
    ] = "1%",
    window: Annotated[
        float | None,
        typer.Option(help="Window in s, between T and 3 T of the response time; 2 T if not given."),
    ] = None,
    yard: Annotated[
        float | None, typer.Option(help="How far in m the machine may get from its start.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the scenario; repeatable."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Write the best as a scenario that simulate accepts."),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the design as JSON.")] = False,
) -> None:
    """Design an excitation: period and window from the machine's response, waveforms compared.

    Each waveform drives the simulated machine; the table says what least squares over one window
    will find, where the window tells least. Exit status 1 when no waveform reaches the accuracy.
    """
    from analysis.excitation import design
    from recordings.output import check_output, keep_apart
    from replay.commands.excite_table import render
    from replay.commands.printing import console, print_json
    from replay.excite import to_dict, write_design
    from replay.scenario import load_scenario

    wanted = _share(accuracy)
    if output:
        keep_apart(output, [scenario] if scenario else [])
        check_output(output, force=force)
    base = load_scenario(scenario, overrides or [])
    made = design(base, motion, wanted, window, yard)
    if as_json:
        print_json(to_dict(made))
    else:
        console().print(render(made))
    if output and made.best:
        write_design(made, base, output, force=force)
        typer.echo(str(output), err=as_json)
    if not made.reached:
        raise typer.Exit(1)


def _share(text: str) -> float:
    """`1%` or `0.01` as 0.01."""
    number, percent, rest = text.strip().partition("%")
    try:
        value = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        value = 0.0
    if rest or not 0.0 < value < 1.0:
        raise typer.BadParameter(f"--accuracy {text}: write it as 1% or 0.01, below 100%")
    return value
