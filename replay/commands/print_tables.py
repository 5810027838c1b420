"""Printing of commands: tables for people, JSON for machines (null for non-finite numbers)."""

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

from estimators.errors import one_line
from replay.commands.screen_limits import LIMITS


def make_stdout_console() -> Console:
    """Console of stdout: as wide as the terminal, or wide enough without one."""
    screen = Console(highlight=False)
    return screen if screen.is_terminal else Console(highlight=False, width=LIMITS.piped_width)


def make_plain_table(*titles: str) -> Table:
    """A table without lines, its first column to the left and the others to the right."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for i, title in enumerate(titles):
        # what a row is about stays whole on a narrow screen
        table.add_column(title, justify="right" if i else "left", no_wrap=not i)
    return table


def print_line(screen: Console, line: str, mark: str = "") -> None:
    """Print one line behind a mark in markup: broken between words on a screen, whole in a pipe."""
    text = Text.from_markup(mark) + Text(one_line(line))
    screen.print(text, soft_wrap=not screen.is_terminal)


def print_table(screen: Console, table: Table, min_columns: int = LIMITS.narrowest_width) -> None:
    """Print a table; rows wrap on a screen of less than `min_columns` columns, nothing is cut."""
    roomy = screen.options.update(max_width=min_columns)
    width = screen.width
    screen.width = max(width, Measurement.get(screen, roomy, table).maximum)
    try:
        screen.print(table)
    finally:
        screen.width = width


def print_rows(
    titles: Sequence[str], rows: Sequence[Sequence[str]], left_aligned: Sequence[int]
) -> None:
    """Print a table of any number of rows without rich, which takes a millisecond per row.

    Nothing is cut: a cell that is much longer than the others runs over its column.

    Args:
        titles: titles of the columns.
        rows: their cells, one line each.
        left_aligned: columns that begin at the left; the others end at the right.
    """
    lines = [tuple(titles), *map(tuple, rows)]
    widths = [
        min(max(map(cell_len, column)), LIMITS.column_characters)
        for column in zip(*lines, strict=True)
    ]
    for line in lines:
        blanks = [" " * (width - cell_len(cell)) for cell, width in zip(line, widths, strict=True)]
        cells = [
            cell + blank if k in left_aligned else blank + cell
            for k, (cell, blank) in enumerate(zip(line, blanks, strict=True))
        ]
        typer.echo("  ".join(cells).rstrip())


def print_json(value: Any) -> None:
    """Print a value as JSON on stdout."""
    typer.echo(format_json(value))


def format_json(value: Any) -> str:
    """A value as JSON text; NaN and infinities become null."""
    return json.dumps(_convert_to_json(value), indent=2, ensure_ascii=False, allow_nan=False)


def format_kilograms(value: float | None) -> str:
    """A mass to a tenth of a kilogram, or a dash."""
    return "–" if value is None else f"{value:,.1f}"


def format_setting_value(value: Any) -> str:
    """A setting as a machine file writes it, on one line; a dash for none."""
    if value is None:
        return "–"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _convert_to_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _convert_to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_convert_to_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
