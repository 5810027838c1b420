"""`payscope compare`: compare two recordings of one log."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from replay.commands.common_options import (
    Calibration,
    RequireSigned,
    SignerKey,
    make_calibration_request,
)
from replay.commands.screen_limits import LIMITS

if TYPE_CHECKING:
    from rich.table import Table

    from analysis.compare.run_comparison import Comparison, EstimateChange, ValueChange
    from analysis.compare.stage_change import ColumnChange


def command(
    a: Annotated[Path, typer.Argument(help="Baseline recording (.rrd).")],
    b: Annotated[Path, typer.Argument(help="Recording to compare with it (.rrd).")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Write a recording of both, with their differences (.rrd)."
        ),
    ] = None,
    rtol: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Relative difference up to which numbers count as equal; 0 compares bit for bit.",
        ),
    ] = 0.0,
    other_logs: Annotated[
        bool,
        typer.Option(
            "--other-logs", help="Compare settings, masses and verdict of different logs."
        ),
    ] = False,
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    force: Annotated[bool, typer.Option(help="Replace an existing recording.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print every difference as JSON.")
    ] = False,
) -> None:
    """Compare two recordings: settings, estimates, manoeuvres and columns that differ.

    Numbers are compared bit for bit unless --rtol is given. With -o a recording shows both over
    each other, B less A below, in A's time; of different logs (--other-logs) each manoeuvre of B
    begins where its counterpart of A does. Exit status 1 when anything differs
    but file names and versions.
    """
    from replay.commands.print_tables import print_json
    from replay.compare.compare_recordings import OverlayOutput, compare_recordings

    found = compare_recordings(
        a,
        b,
        OverlayOutput(output, force),
        relative_tolerance=rtol,
        allows_different_logs=other_logs,
        calibration=make_calibration_request(
            calibration, key, is_signature_required=require_signed
        ),
    )
    if as_json:
        print_json({"a": str(a), "b": str(b), **found.to_dict()})
    else:
        _print_recording_differences(found, a, b, rtol)
    if not found.is_equal:
        raise typer.Exit(1)


def _print_recording_differences(
    comparison: "Comparison", recording_a: Path, recording_b: Path, relative_tolerance: float
) -> None:
    """Print the differences, first those of the answer; equal items are not printed."""
    from estimators.errors import format_count
    from replay.commands.print_tables import make_stdout_console, print_line, print_table_uncut

    screen = make_stdout_console()

    def print_part(title: str, table: "Table", rows: int) -> None:
        screen.print(f"\n{title}", markup=False)
        for column in table.columns:
            column.no_wrap = column.overflow != "fold"
        print_table_uncut(screen, table, LIMITS.compared_width)
        if rows > LIMITS.compared_rows:
            screen.print(f"… and {rows - LIMITS.compared_rows} more: --json gives all")

    print_line(screen, f"A  {recording_a}")
    print_line(screen, f"B  {recording_b}")
    for title, changes in (
        ("settings", comparison.settings),
        ("checks passed", comparison.checks),
        ("inputs", comparison.inputs),
        ("versions", comparison.versions),
        ("losses, notes and stamps", comparison.provenance),
    ):
        if changes:
            print_part(f"{title}:", _make_value_change_table(changes), len(changes))
    if comparison.estimates:
        title = "estimates over the whole log, those that moved most first:"
        print_part(
            title,
            _make_estimate_change_table("method", comparison.estimates),
            len(comparison.estimates),
        )
    if comparison.manoeuvres:
        title = "manoeuvres, those that moved most first:"
        print_part(
            title,
            _make_estimate_change_table("manoeuvre", comparison.manoeuvres),
            len(comparison.manoeuvres),
        )
    for name, only in (("A", comparison.only_a), ("B", comparison.only_b)):
        if only:
            screen.print()
            print_line(screen, f"stages in {name} alone: {', '.join(only)}")
    if comparison.stages:
        differing = sum(len(stage.columns) for stage in comparison.stages)
        title = (
            f"columns: {differing} of {comparison.columns} differ; "
            "the largest changes of each stage:"
        )
        print_part(title, _make_column_change_table(comparison), 0)
    whole = format_count(comparison.columns, "column")
    exact = (
        f"within a relative difference of {relative_tolerance:g}"
        if relative_tolerance
        else "bit for bit"
    )
    said = f"Equal: {whole}, {exact}." if comparison.is_equal else f"They differ, compared {exact}."
    screen.print(f"\n{said}", markup=False)


def _make_value_change_table(value_changes: Iterable["ValueChange"]) -> "Table":
    from rich.markup import escape

    from replay.commands.print_tables import format_setting_value, make_plain_table

    table = make_plain_table("", "A", "B")
    for column in table.columns[1:]:
        column.justify, column.overflow = "left", "fold"
    for change in list(value_changes)[: LIMITS.compared_rows]:
        table.add_row(
            *(
                escape(text)
                for text in (
                    change.name,
                    format_setting_value(change.a),
                    format_setting_value(change.b),
                )
            )
        )
    return table


_UNITS: Final = {
    "mass_kg": "mass kg",
    "friction_x_N_s_m": "friction N·s/m",
    "coulomb_x_N": "Coulomb N",
    "inertia_z_kg_m2": "yaw inertia kg·m²",
    "friction_z_N_m_s": "turning N·m·s",
}


def _make_estimate_change_table(
    row_heading: str, estimate_changes: Iterable["EstimateChange"]
) -> "Table":
    from replay.commands.print_tables import make_plain_table

    table = make_plain_table(row_heading, "", "A", "B", "change", "in std")
    table.columns[1].justify = "left"
    for each in list(estimate_changes)[: LIMITS.compared_rows]:
        table.add_row(
            each.about,
            _UNITS.get(each.quantity, each.quantity),
            _format_estimate(each.a, each.a_std),
            _format_estimate(each.b, each.b_std),
            _format_signed_change(each.value_change),
            "" if each.change_in_stds is None else f"{each.change_in_stds:+.2f}",
        )
    return table


def _format_estimate(value: float | None, std: float | None) -> str:
    if value is None:
        return "none"
    return f"{value:,.2f}" + ("" if std is None else f" ± {std:,.2f}")


def _format_signed_change(estimate_change: float | None) -> str:
    if estimate_change is None:
        return ""
    return (
        f"{estimate_change:+,.2f}" if abs(estimate_change) >= 0.005 else f"{estimate_change:+.1e}"
    )


def _make_column_change_table(recording_comparison: "Comparison") -> "Table":
    from rich.markup import escape

    from estimators.errors import format_count
    from replay.commands.print_tables import make_plain_table

    table = make_plain_table(
        "stage", "column", "rows that differ", "largest change", "relative", "at s"
    )
    table.columns[1].justify = "left"
    for stage in recording_comparison.stages:
        about = stage.name
        if stage.rows_a != stage.rows_b or stage.common != stage.rows_a:
            rows = (
                f"{format_count(stage.rows_a, 'row')} in A, {stage.rows_b:,} in B, "
                f"{stage.common:,} in both"
            )
            table.add_row(escape(about), rows)
            about = ""
        if stage.order:
            table.add_row(escape(about), "the order of the columns")
            about = ""
        by_change = sorted(
            stage.columns,
            key=lambda column: (column.largest_relative or 0.0, column.rows),
            reverse=True,
        )
        for column in by_change[: LIMITS.compared_columns]:
            table.add_row(
                escape(about), escape(column.name), *_make_column_change_cells(column, stage.common)
            )
            about = ""
        if len(by_change) > LIMITS.compared_columns:
            table.add_row("", f"… and {len(by_change) - LIMITS.compared_columns} more")
    return table


def _make_column_change_cells(column_change: "ColumnChange", prefix_length: int) -> tuple[str, ...]:
    if column_change.fault:
        return (column_change.fault,)
    rows = f"{column_change.rows:,} ({column_change.rows / prefix_length:.1%})"
    return (
        rows,
        "" if column_change.largest is None else f"{column_change.largest:+.3g}",
        "" if column_change.largest_relative is None else f"{column_change.largest_relative:.1e}",
        "" if column_change.at_s is None else f"{column_change.at_s:,.2f}",
    )
