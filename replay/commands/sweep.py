"""`payscope sweep`: replay logs with several settings, as in the paper's Tables 3 and 4."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from replay.commands.common_options import (
    Calibration,
    FormatOption,
    FrameFormat,
    Logs,
    OutputFile,
    RequireSigned,
    SignerKey,
    make_calibration_request,
)
from replay.commands.screen_limits import LIMITS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    import polars as pl
    from rich.console import RenderableType
    from rich.table import Table

    from recordings.plots.sweep_figure import SweptRow
    from replay.calibration.apply_evidence import CalibrationRequest
    from replay.runs.sweep_settings import SweepRow

#: The same titles as labels of an axis.
_DRAWN: Final = {
    "error_kg": "mass less the\nreference (kg)",
    "rmse_kg": "r.m.s. error of\nthe runs (kg)",
    "calibrated_rmse_kg": "r.m.s. error,\ncalibrated (kg)",
    "left_out_rmse_kg": "the same, own load\nleft out (kg)",
}
_TITLES: Final = {
    "error_kg": "Mass less the reference, kg",
    "rmse_kg": "Root mean square error of the runs' masses before calibration, kg",
    "calibrated_rmse_kg": "Root mean square error after calibration by (19), kg",
    "left_out_rmse_kg": "Root mean square error with the run's own load left out of the fit, kg",
}


def command(
    logs: Logs,
    machine: Annotated[Path, typer.Option("-m", "--machine", help="The machine file.")],
    over: Annotated[
        list[str],
        typer.Option(
            "--over",
            metavar="KEY=VALUES",
            help="Setting to vary: KEY=FROM:TO:STEP (TO included if a step reaches it) or "
            "KEY=A,B,C; repeatable, for a grid.",
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the machine file; repeatable."),
    ] = None,
    reference_kg: Annotated[
        float | None,
        typer.Option(
            "--reference", metavar="KG", help="The true mass; also show the error of each mass."
        ),
    ] = None,
    output_format: FormatOption = None,
    calibration: Calibration = None,
    key: SignerKey = None,
    require_signed: RequireSigned = False,
    as_json: Annotated[bool, typer.Option("--json", help="Same as --format json.")] = False,
    output: OutputFile = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", help="Draw masses and errors as a picture (.png, .pdf or .svg)."),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace existing files.")] = False,
) -> None:
    """Replay logs once for each combination of settings and compare masses and verdicts.

    If the truth of a simulation lies next to the logs, the root mean square errors of the runs'
    masses are given as in the paper's Tables 3 and 4, and drawn with --figure. A combination that
    cannot weigh has no mass. Exit status 1 if none can.
    """
    if as_json and output_format not in (None, FrameFormat.json):
        raise typer.BadParameter("--json and --format differ; give one of them")
    if reference_kg is not None and not 0.0 < reference_kg < math.inf:
        raise typer.BadParameter(f"--reference {reference_kg:g}: give a mass in kg, above 0")
    wanted = FrameFormat.json if as_json else output_format
    weighs = run_and_print_sweep(
        (logs, machine, overrides or [], over),
        reference_kg=reference_kg,
        calibration=make_calibration_request(
            calibration, key, is_signature_required=require_signed
        ),
        output_format=wanted and wanted.value,
        output_paths=(output, figure),
        overwrites=force,
    )
    if not weighs:
        typer.echo("No combination can weigh: every mass is withheld.", err=True)
        raise typer.Exit(1)


def run_and_print_sweep(
    sweep_inputs: tuple[list[Path], Path, list[str], list[str]],
    *,
    reference_kg: float | None,
    calibration: CalibrationRequest | None,
    output_format: str | None,
    output_paths: tuple[Path | None, Path | None],
    overwrites: bool,
) -> bool:
    """Run the sweep, and print, write and draw its rows.

    Returns:
        Whether any combination can weigh.
    """
    from estimators.errors import OutputError
    from recordings.report.atomic_output import refuse_input_as_output, require_writable_output
    from recordings.report.picture import require_writable_picture
    from replay.commands.frame_output import choose_output_format, print_or_write_frame
    from replay.commands.print_tables import make_stdout_console
    from replay.commands.progress_bar import StageProgress
    from replay.runs.sweep_settings import list_value_combinations, sweep_setting_combinations

    logs, machine_file, overrides, over = sweep_inputs
    output, figure = output_paths
    output_format = choose_output_format(output_format, output)
    if output is not None:
        refuse_input_as_output(output, [*logs, machine_file])
        require_writable_output(output, overwrites=overwrites)
    if figure is not None:
        refuse_input_as_output(figure, [*logs, machine_file])
        require_writable_picture(figure, overwrites=overwrites)
        if figure == output:
            raise OutputError(
                f"{figure}: is named for both -o and --figure; give two different files"
            )
    grid = list_value_combinations(over)
    with StageProgress(len(grid)) as stages:
        rows = sweep_setting_combinations(
            logs,
            machine_file,
            overrides,
            grid,
            reference_kg=reference_kg,
            calibration=calibration,
            on_stage=stages.begin_stage,
        )
    if output is None and output_format == "table":
        make_stdout_console().print(render_sweep_tables(rows))
    else:
        print_or_write_frame(
            _make_frame_of_results(rows),
            output_format,
            output,
            overwrites=overwrites,
            render=lambda: _format_swept_setting_value(render_sweep_tables(rows)),
            json_records=[_make_json_row(row) for row in rows],
        )
    if figure is not None:
        from recordings.plots.sweep_figure import plot_sweep

        drawn = plot_sweep(
            [_make_figure_row(row) for row in rows],
            figure,
            reference_kg=reference_kg,
            overwrites=overwrites,
        )
        typer.echo(f"figure: {drawn}", err=True)
    return any(row.answer.verdict.can_weigh for row in rows)


def _make_figure_row(sweep_row: SweepRow) -> SweptRow:
    """Make a row for the sweep's figure."""
    from recordings.plots.sweep_figure import SweptRow

    names = find_shortest_distinct_names(sweep_row.over)
    known = [load for load in sweep_row.answer.loads if load["payload_kg"] is not None]
    several = len(sweep_row.answer.loads) > 1 and known
    most = max(known, key=lambda load: load["payload_kg"]) if several else None
    return SweptRow(
        over={names[key]: value for key, value in _parse_swept_setting_values(sweep_row).items()},
        mass_kg=_read_quantity_by_method(sweep_row, "mass_kg"),
        mass_std_kg=_read_quantity_by_method(sweep_row, "mass_std_kg"),
        payload_kg=None if most is None else (most["payload_kg"], most["payload_u_kg"] or 0.0),
        errors={_DRAWN[name]: errors for name, errors in sweep_row.errors.items()},
        accepted_share_1=sweep_row.answer.accepted_share,
        can_weigh=sweep_row.answer.verdict.can_weigh,
    )


def _make_json_row(sweep_row: SweepRow) -> dict[str, Any]:
    """Make a row in the format of `run --json`, with the varied settings and the errors."""
    # without items that need hashes: logs that are replayed many times are not hashed
    left_out = ("losses", "notes", "recording", "fingerprint")
    answer_entries = {
        name: value for name, value in sweep_row.answer.to_dict().items() if name not in left_out
    }
    return {"over": _parse_swept_setting_values(sweep_row), **answer_entries, **sweep_row.errors}


def _make_frame_of_results(sweep_rows: Sequence[SweepRow]) -> pl.DataFrame:
    """Make a frame with a row per combination and a column per method and quantity."""
    names = find_shortest_distinct_names(sweep_rows[0].over)
    flat = [
        {
            **{
                # lists and tables cannot be cells: they are kept as text
                names[key]: row.over[key] if isinstance(value, list | dict) else value
                for key, value in _parse_swept_setting_values(row).items()
            },
            **{
                f"{method}_{name}": value
                for name in ("mass_kg", "mass_std_kg", *row.errors)
                for method, value in (
                    row.errors.get(name) or _read_quantity_by_method(row, name)
                ).items()
            },
            **make_calibrated_mass_fields(row),
            "accepted_share_1": row.answer.accepted_share,
            "can_weigh": row.answer.verdict.can_weigh,
            "failed": " ".join(_list_failed_check_names(row)),
        }
        for row in sweep_rows
    ]
    import polars as pl

    # methods may differ between rows, and may be withheld in the first
    return pl.from_dicts(flat, infer_schema_length=None)


def make_calibrated_mass_fields(sweep_row: SweepRow) -> dict[str, float | str | None]:
    """Make the fields of the calibrated mass, None for several loads; none without calibration."""
    loads = sweep_row.answer.loads
    if not loads or "calibrated_kg" not in loads[0]:
        return {}
    names = ("calibrated_kg", "calibrated_low_kg", "calibrated_high_kg", "calibrated_reason")
    return {name: loads[0][name] if len(loads) == 1 else None for name in names}


def render_sweep_tables(sweep_rows: Sequence[SweepRow]) -> RenderableType:
    """Render a table of masses and verdicts, and tables of errors if the truth is known."""
    from rich.console import Group

    from replay.commands.print_tables import format_mass_kg_or_dash

    masses = make_table_of_combinations_by_method(
        sweep_rows, _format_mass_of_method, ("used", "weighs"), _make_verdict_cells
    )
    parts: list[RenderableType] = ["Mass ± standard deviation, kg", masses]
    if make_calibrated_mass_fields(sweep_rows[0]):
        parts += [
            "",
            "Calibrated mass and its interval, kg",
            make_calibrated_mass_table(sweep_rows),
        ]
    for name in sweep_rows[0].errors:
        errors = make_table_of_combinations_by_method(
            sweep_rows,
            lambda row, method, of=name: format_mass_kg_or_dash(row.errors[of].get(method)),
        )
        parts += ["", _TITLES[name], errors]
    return Group(*parts)


def make_table_of_combinations_by_method(
    sweep_rows: Sequence[SweepRow],
    format_cell: Callable[[SweepRow, str], str],
    extra_titles: Sequence[str] = (),
    extra_cells: Callable[[SweepRow], Sequence[str]] = lambda _: (),
) -> Table:
    """Make a table with a row per combination, a cell per method, and further columns."""
    from replay.commands.print_tables import make_plain_table

    methods = list(
        dict.fromkeys(
            method for row in sweep_rows for method in _read_quantity_by_method(row, "mass_kg")
        )
    )
    table = make_plain_table(
        *find_shortest_distinct_names(sweep_rows[0].over).values(), *methods, *extra_titles
    )
    if extra_titles:
        # the last column has text
        table.columns[-1].justify = "left"
    for row in sweep_rows:
        table.add_row(
            *row.over.values(), *(format_cell(row, method) for method in methods), *extra_cells(row)
        )
    return table


def make_calibrated_mass_table(sweep_rows: Sequence[SweepRow]) -> Table:
    """Make a table with the calibrated mass of each combination, or why there is none."""
    from replay.commands.print_tables import format_mass_kg_or_dash, make_plain_table

    table = make_plain_table(
        *find_shortest_distinct_names(sweep_rows[0].over).values(), "calibrated", "from", "to"
    )
    table.add_column("", overflow="fold")
    for row in sweep_rows:
        mass, low, high, reason = make_calibrated_mass_fields(row).values()
        numbers = (value if isinstance(value, float) else None for value in (mass, low, high))
        why = reason if reason is not None else "several loads: --json has each"
        table.add_row(*row.over.values(), *map(format_mass_kg_or_dash, numbers), str(why))
    return table


def _format_mass_of_method(sweep_row: SweepRow, method: str) -> str:
    from replay.commands.print_tables import format_mass_kg_or_dash

    mass, std = (
        _read_quantity_by_method(sweep_row, name).get(method) for name in ("mass_kg", "mass_std_kg")
    )
    return format_mass_kg_or_dash(mass) + ("" if std is None else f" ± {std:.1f}")


def _make_verdict_cells(sweep_row: SweepRow) -> Sequence[str]:
    failed = _list_failed_check_names(sweep_row)
    loads = len(sweep_row.answer.loads)
    known = [load for load in sweep_row.answer.loads if load["payload_kg"] is not None]
    most = max((load["payload_kg"] for load in known), default=None)
    carried = "" if most is None else f", payload up to {most:,.1f} kg"
    yes = f"yes, {loads} loads{carried}" if loads > 1 else "yes"
    weighs = f"no: {', '.join(failed)}" if failed else yes
    return f"{sweep_row.answer.accepted_share:.0%}", weighs


def _list_failed_check_names(sweep_row: SweepRow) -> list[str]:
    verdict = sweep_row.answer.verdict
    return [
        check.check
        for check in (
            *verdict.list_withholding_checks("mass"),
            *verdict.list_withholding_checks("inertia"),
        )
    ]


def _read_quantity_by_method(sweep_row: SweepRow, quantity: str) -> Mapping[str, float | None]:
    """Read a quantity of the answer by method; empty for a log without masses."""
    return sweep_row.answer.rows[0].quantities[quantity] if sweep_row.answer.rows else {}


def _parse_swept_setting_values(sweep_row: SweepRow) -> dict[str, Any]:
    from replay.machines.toml_file import parse_toml_value

    return {key: parse_toml_value(text) for key, text in sweep_row.over.items()}


def find_shortest_distinct_names(dotted_keys: Iterable[str]) -> dict[str, str]:
    """Find the shortest distinct name of each dotted key: its last part, or the whole key."""
    last = {key: key.rpartition(".")[2] for key in dotted_keys}
    shared = Counter(last.values())
    return {key: name if shared[name] == 1 else key for key, name in last.items()}


def _format_swept_setting_value(value: RenderableType) -> str:
    from io import StringIO

    from rich.console import Console

    text = StringIO()
    Console(file=text, width=LIMITS.file_width, highlight=False).print(value)
    return "".join(f"{line.rstrip()}\n" for line in text.getvalue().splitlines())
