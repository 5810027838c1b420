"""Print tables for people and JSON for programs (with null for non-finite numbers)."""

import json
import math
from collections.abc import Sequence
from typing import Any

import typer
from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from estimators.errors import join_to_one_line
from replay.commands.screen_limits import LIMITS


def make_stdout_console() -> Console:
    """Make a console on stdout, as wide as the terminal, or `LIMITS.piped_width` without one."""
    screen = Console(highlight=False)
    return screen if screen.is_terminal else Console(highlight=False, width=LIMITS.piped_width)


def make_plain_table(*column_titles: str) -> Table:
    """Make a table without lines, whose first column is left-aligned and others right-aligned."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for i, title in enumerate(column_titles):
        # the first column, which identifies a row, is not wrapped on a narrow screen
        table.add_column(title, justify="right" if i else "left", no_wrap=not i)
    return table


def print_line(console: Console, line: str, prefix_markup: str = "") -> None:
    """Print a line after a mark in markup; it is wrapped on a screen, and not in a pipe."""
    text = Text.from_markup(prefix_markup) + Text(join_to_one_line(line))
    console.print(text, soft_wrap=not console.is_terminal)


def print_table_uncut(
    console: Console, table: Table, min_width: int = LIMITS.narrowest_width
) -> None:
    """Print a table without cutting cells; rows wrap if the screen has less than `min_width`."""
    roomy = console.options.update(max_width=min_width)
    width = console.width
    console.width = max(width, Measurement.get(console, roomy, table).maximum)
    try:
        console.print(table)
    finally:
        console.width = width


def print_rows_as_table(
    column_titles: Sequence[str], rows: Sequence[Sequence[str]], left_aligned_columns: Sequence[int]
) -> None:
    """Print a table of any number of rows without rich, which takes a millisecond per row.

    Cells are not cut: one that is much longer than the others extends beyond its column.

    Args:
        column_titles: titles of the columns.
        rows: cells of the rows, in the order of the columns.
        left_aligned_columns: indices of left-aligned columns; the others are right-aligned.
    """
    lines = [tuple(column_titles), *map(tuple, rows)]
    widths = [
        min(max(map(cell_len, column)), LIMITS.column_characters)
        for column in zip(*lines, strict=True)
    ]
    for line in lines:
        blanks = [" " * (width - cell_len(cell)) for cell, width in zip(line, widths, strict=True)]
        cells = [
            cell + blank if k in left_aligned_columns else blank + cell
            for k, (cell, blank) in enumerate(zip(line, blanks, strict=True))
        ]
        typer.echo("  ".join(cells).rstrip())


def print_json(value: Any) -> None:
    """Print a value as JSON on stdout."""
    typer.echo(format_value_as_json(value))


def format_value_as_json(value: Any) -> str:
    """Format a value as JSON; NaN and infinities become null.

    Bytes of a file name that are not UTF-8 become JSON's escapes of unpaired surrogates.
    """
    text = json.dumps(_convert_to_json_values(value), indent=2, ensure_ascii=False, allow_nan=False)
    return text.encode(errors="backslashreplace").decode()


def format_mass_kg_or_dash(mass_kg: float | None) -> str:
    """Format a mass to a tenth of a kilogram; a dash for None."""
    return "–" if mass_kg is None else f"{mass_kg:,.1f}"


def format_setting_value(setting_value: Any) -> str:
    """Format a setting in one line as in a machine file; a dash for None."""
    if setting_value is None:
        return "–"
    return (
        setting_value
        if isinstance(setting_value, str)
        else json.dumps(setting_value, ensure_ascii=False)
    )


def _convert_to_json_values(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _convert_to_json_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_convert_to_json_values(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
