"""The rows of a sweep as tables, CSV, JSON or Parquet."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, Final

import polars as pl
from rich.console import Console, Group, RenderableType
from rich.table import Table

from recordings.output import check_output, keep_apart
from replay.commands.printing import console, plain_table
from replay.commands.progress import Stages
from replay.commands.tables import format_of, print_frame
from replay.grid import combinations
from replay.sweep import Row, sweep
from replay.toml_file import read_value

#: Whoever reads a file can scroll.
_FILE_WIDTH: Final = 400
_TITLES: Final = {
    "error_kg": "Mass less the reference, kg",
    "rmse_kg": "Root mean square error of the runs' masses as they are, kg",
    "calibrated_rmse_kg": "The same after calibration by (19), kg",
    "left_out_rmse_kg": "The same with the run's own load left out of the fit, kg",
}


def print_sweep(
    logs: Sequence[Path],
    machine_file: Path,
    overrides: Sequence[str],
    over: Sequence[str],
    *,
    reference_kg: float | None,
    output_format: str | None,
    output: Path | None,
    force: bool,
) -> bool:
    """Sweep, and print the rows or write them to `output`.

    Returns:
        Whether any combination can weigh.

    Raises:
        PayscopeError: whatever is wrong with the input, before anything is written.
    """
    output_format = format_of(output_format, output)
    if output is not None:
        keep_apart(output, [*logs, machine_file])
        check_output(output, force=force)
    grid = combinations(over)
    with Stages(total=len(grid)) as stages:
        rows = sweep(
            logs, machine_file, overrides, grid, reference_kg=reference_kg, on_stage=stages.begin
        )
    if output is None and output_format == "table":
        console().print(_tables(rows))
    else:
        print_frame(
            _frame(rows),
            output_format,
            output,
            force=force,
            table=lambda: _text(_tables(rows)),
            records=[_nested(row) for row in rows],
        )
    return any(row.answer["verdict"]["can_weigh"] for row in rows)


def _nested(row: Row) -> dict[str, Any]:
    """A row as `run --json` gives it, with what was varied and the errors."""
    told = {name: row.answer[name] for name in row.answer if name not in ("losses", "notes")}
    return {"over": _typed(row), **told, **row.errors}


def _frame(rows: Sequence[Row]) -> pl.DataFrame:
    """A row a combination, a column a method and quantity; what was varied is a number or text."""
    names = _names(rows[0].over)
    flat = [
        {
            **{names[key]: _flat(value, row.over[key]) for key, value in _typed(row).items()},
            **{
                f"{method}_{name}": value
                for name in ("mass_kg", "mass_std_kg", *row.errors)
                for method, value in (row.errors | row.answer)[name].items()
            },
            "accepted_share_1": row.answer["accepted_share"],
            "can_weigh": row.answer["verdict"]["can_weigh"],
            "failed": " ".join(_failed(row)),
        }
        for row in rows
    ]
    # methods may differ from row to row, and be withheld in the first
    return pl.from_dicts(flat, infer_schema_length=None)


def _tables(rows: Sequence[Row]) -> RenderableType:
    """Masses and verdict a combination; below, where a truth is known, how wrong they are."""
    masses = _table(rows, _mass, ("used", "weighs"), _verdict)
    parts: list[RenderableType] = ["Mass ± standard deviation, kg", masses]
    for name in rows[0].errors:
        errors = _table(rows, lambda row, method, of=name: _kg(row.errors[of].get(method)))
        parts += ["", _TITLES[name], errors]
    return Group(*parts)


def _table(
    rows: Sequence[Row],
    cell: Callable[[Row, str], str],
    more: Sequence[str] = (),
    rest: Callable[[Row], Sequence[str]] = lambda _: (),
) -> Table:
    """A row a combination: what was varied, a cell a method, and more columns."""
    methods = list(dict.fromkeys(method for row in rows for method in row.answer["mass_kg"]))
    table = plain_table(*_names(rows[0].over).values(), *methods, *more)
    if more:
        # the last is words
        table.columns[-1].justify = "left"
    for row in rows:
        table.add_row(*row.over.values(), *(cell(row, method) for method in methods), *rest(row))
    return table


def _mass(row: Row, method: str) -> str:
    mass, std = (row.answer[name].get(method) for name in ("mass_kg", "mass_std_kg"))
    return _kg(mass) + ("" if std is None else f" ± {std:.1f}")


def _kg(value: float | None) -> str:
    return "–" if value is None else f"{value:,.1f}"


def _verdict(row: Row) -> Sequence[str]:
    failed = _failed(row)
    weighs = f"no: {', '.join(failed)}" if failed else "yes"
    return f"{row.answer['accepted_share']:.0%}", weighs


def _failed(row: Row) -> list[str]:
    checks = row.answer["verdict"]["checks"]
    return [check["check"] for check in checks if check["passed"] is False]


def _typed(row: Row) -> dict[str, Any]:
    return {key: read_value(text) for key, text in row.over.items()}


def _flat(value: Any, written: str) -> Any:
    """A value for a column that a file may hold: a list or table as it was written."""
    return written if isinstance(value, list | dict) else value


def _names(keys: Iterable[str]) -> dict[str, str]:
    """What a table calls each dotted key: its last part, or all of it where two share that."""
    last = {key: key.rpartition(".")[2] for key in keys}
    shared = Counter(last.values())
    return {key: name if shared[name] == 1 else key for key, name in last.items()}


def _text(shown: RenderableType) -> str:
    text = StringIO()
    Console(file=text, width=_FILE_WIDTH, highlight=False).print(shown)
    return "".join(f"{line.rstrip()}\n" for line in text.getvalue().splitlines())
