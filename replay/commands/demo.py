"""`payscope demo`: simulate the paper's campaign, calibrate, verify, and review a shift."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType

    from replay.demo.run_demo import DemoResults


def command(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The folder for the demo's files.")
    ] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated noise.")] = 1,
    force: Annotated[bool, typer.Option(help="Replace the files of an earlier demo.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Simulate six loads × nine starts as ROS bags, calibrate, verify; then review a shift."""
    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.commands.progress_bar import StageProgress
    from replay.commands.review import print_shift_review
    from replay.demo.run_demo import STEPS, run_demo

    with StageProgress(len(STEPS)) as stages:
        result = run_demo(output, seed=seed, overwrites=force, on_stage=stages.begin_stage)
    if as_json:
        print_json(result.to_dict())
    else:
        screen = make_stdout_console()
        screen.print(_render_demo_results(result))
        screen.print("\nA shift of that machine, reviewed under that evidence:")
        print_shift_review(screen, result.reviewed)


def _render_demo_results(demo_results: "DemoResults") -> "RenderableType":
    """Render tables and notes of the demo for the terminal."""
    import polars as pl
    from rich.console import Group

    from analysis.model.answer import JOINT
    from replay.commands.print_tables import format_mass_kg_or_dash, make_plain_table

    loads = make_plain_table(
        "load kg",
        "starts",
        "estimate kg",
        "± kg a start",
        "calibrated kg",
        "error kg",
        "left out kg",
    )
    loads.title = "The joint fit, means of nine starts, calibrated"
    for row in demo_results.calibration.filter(pl.col("method") == JOINT).iter_rows(named=True):
        numbers = (
            row["estimate_kg"],
            row["estimate_std_kg"],
            row["calibrated_kg"],
            row["error_kg"],
            row["error_left_out_kg"],
        )
        loads.add_row(
            f"{row['load_kg']:.0f}", str(row["runs"]), *map(format_mass_kg_or_dash, numbers)
        )
    methods = make_plain_table(
        "method", "in-sample kg", "one load left out kg", "of the load range"
    )
    methods.title = "Root mean square errors of the load means"
    for table in (loads, methods):
        table.title_justify = "left"
    for row in demo_results.errors.iter_rows(named=True):
        left_out = row["rmse_left_out_kg"]
        share = None if left_out is None else left_out / row["load_range_kg"]
        methods.add_row(
            row["method"],
            format_mass_kg_or_dash(row["rmse_kg"]),
            format_mass_kg_or_dash(left_out),
            "–" if share is None else f"{share:.1%}",
        )
    constant = demo_results.errors["rmse_constant_kg"].drop_nulls()
    notes = [f"A constant predictor scores {constant[0]:.1f} kg."] if constant.len() else []
    made = [f"  {path}" for path in demo_results.files]
    line = demo_results.calibrated.document.calibration
    if line is not None:
        half_kg = line.u_kg * line.coverage_k_1
        notes.append(f"Evidence: a later mass from nine starts is known to ± {half_kg:.1f} kg.")
    notes.append("The evidence is signed with a key made for the demo; keep a real key elsewhere.")
    notes += [
        *(str(finding) for finding in demo_results.verified.findings),
        demo_results.verified.verdict,
    ]
    return Group(loads, "", methods, *notes, "", "Files:", *made)
