"""Print or write frames as CSV, JSON, Parquet or Arrow; commands render tables themselves."""

import shutil
import sys
from collections.abc import Callable
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, Final

import polars as pl
import typer
from rich.cells import cell_len

from estimators.errors import OutputError
from recordings.report.atomic_output import atomic_file
from replay.commands.print_tables import format_json
from replay.commands.screen_limits import LIMITS

#: What `-o` may end in.
_WRITTEN: Final = ("csv", "json", "parquet", "arrow")
#: Bytes that no screen shows.
_BINARY: Final = ("parquet", "arrow")


def choose_output_format(requested: str | None, output: Path | None) -> str:
    """Requested format, else that of the output's suffix, else a table.

    Raises:
        OutputError: unknown suffix, or a binary format for a terminal.
    """
    if requested is None and output is not None:
        requested = output.suffix.removeprefix(".")
        if requested not in _WRITTEN:
            raise OutputError(
                f"{output}: no format '{output.suffix}'; use "
                f"{', '.join(f'.{x}' for x in _WRITTEN)}, or give --format"
            )
    if requested in _BINARY and output is None:
        raise OutputError(f"{requested.capitalize()} is a binary format; give a file with -o")
    return requested or "table"


def print_or_write_frame(
    frame: pl.DataFrame,
    output_format: str,
    output: Path | None,
    *,
    force: bool,
    table: Callable[[], str],
    records: Any = None,
) -> None:
    """Print a frame, or write it to a file.

    Args:
        frame: the rows.
        output_format: table, csv, json, parquet or arrow.
        output: file to write; None for stdout.
        force: whether to replace an existing file.
        table: renders the frame as a table.
        records: values for JSON instead of the rows.

    Raises:
        OutputError: the output cannot be written.
    """

    def frame_as_text() -> str:
        match output_format:
            case "json":
                return (
                    format_json(
                        _format_times_as_text(frame).to_dicts() if records is None else records
                    )
                    + "\n"
                )
            case "csv":
                # polars says of a closed pipe only that some writing failed
                return frame.write_csv()
            case _:
                return table()

    if output is None:
        if output_format == "csv":
            sys.stdout.write(frame_as_text())
        else:
            typer.echo(frame_as_text(), nl=False)
        return
    with atomic_file(output, force=force) as partial:
        if output_format in _BINARY:
            # by way of memory: polars says of a full disk only that some computing failed
            written = BytesIO()
            if output_format == "arrow":
                frame.write_ipc(written, compat_level=pl.CompatLevel.oldest())
            else:
                frame.write_parquet(written)
            partial.write_bytes(written.getvalue())
        else:
            partial.write_text(frame_as_text(), encoding="utf-8")


def _format_times_as_text(frame: pl.DataFrame) -> pl.DataFrame:
    """Times as ISO 8601 text to the nanosecond; Python's own formatting stops at microseconds."""
    return frame.with_columns(pl.col(pl.Datetime).dt.to_string("iso:strict"))


def print_frame(frame: pl.DataFrame, choice: str = "") -> None:
    """Print the ends of a frame as a table that fits the terminal, and how to get the others.

    Args:
        frame: the rows.
        choice: options that choose rows, for the note on those that are not shown.
    """
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    typer.echo(format_frame_as_table(frame, LIMITS.frame_rows, width), nl=False)
    if frame.height > LIMITS.frame_rows:
        note = f"{frame.height} rows, {LIMITS.frame_rows} shown; {choice}--format csv gives all"
        typer.echo(note, err=True)


def format_frame_as_table(frame: pl.DataFrame, rows: int, width: int | None = None) -> str:
    """A frame as text, its cells whole: broken ones cannot be read.

    Args:
        frame: the rows.
        rows: most rows to print.
        width: columns of a screen; a wider frame stands there in parts, one below the other, each
            behind the columns that say what its rows are. None for lines as long as they must be.
    """
    if width is None:
        return _render_frame(frame, rows)
    wide = {
        name: _longest_line_length(_render_frame(frame.select(name), rows))
        for name in frame.columns
    }
    # local time and seconds say where a row is, or what stands first
    names = frame.columns[: 2 if frame.columns[1:2] == ["t_s"] else 1]
    parts: list[list[str]] = [names]
    for name in frame.columns[len(names) :]:
        if parts[-1] != names and sum(wide[each] for each in [*parts[-1], name]) > width:
            parts.append([*names])
        parts[-1] = [*parts[-1], name]
    return "\n".join(_render_frame(frame.select(part), rows) for part in parts)


def _longest_line_length(text: str) -> int:
    return max(map(cell_len, text.splitlines()), default=0)


def _render_frame(frame: pl.DataFrame, rows: int) -> str:
    text = StringIO()
    with pl.Config(
        tbl_rows=rows,
        tbl_cols=-1,
        tbl_width_chars=LIMITS.text_table_characters,
        fmt_str_lengths=80,
        tbl_hide_column_data_types=True,
        tbl_formatting="NOTHING",
        tbl_hide_dataframe_shape=True,
    ):
        print(frame, file=text)
    return text.getvalue()
