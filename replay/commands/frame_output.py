"""Print or write frames as tables, CSV, JSON, Parquet or Arrow."""

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
from recordings.report.atomic_output import stage_output_file
from replay.commands.print_tables import format_value_as_json
from replay.commands.screen_limits import LIMITS

#: Suffixes that `-o` may have.
_WRITTEN: Final = ("csv", "json", "parquet", "arrow")
#: Binary formats, which are not printed on a terminal.
_BINARY: Final = ("parquet", "arrow")


def choose_output_format(requested_format: str | None, output_path: Path | None) -> str:
    """Choose the requested format, else that of the output's suffix, else a table.

    Raises:
        OutputError: the suffix is unknown, or a binary format would be printed on a terminal.
    """
    if requested_format is None and output_path is not None:
        requested_format = output_path.suffix.removeprefix(".")
        if requested_format not in _WRITTEN:
            raise OutputError(
                f"{output_path}: unknown format '{output_path.suffix}'; use "
                f"{', '.join(f'.{x}' for x in _WRITTEN)}, or give --format"
            )
    if requested_format in _BINARY and output_path is None:
        raise OutputError(
            f"{requested_format.capitalize()} is a binary format; give a file with -o"
        )
    return requested_format or "table"


def print_or_write_frame(
    frame: pl.DataFrame,
    output_format: str,
    output: Path | None,
    *,
    overwrites: bool,
    render: Callable[[], str],
    json_records: Any = None,
) -> None:
    """Print a frame, or write it to a file.

    Args:
        frame: the rows.
        output_format: table, csv, json, parquet or arrow.
        output: file to write; None for stdout.
        overwrites: whether to replace an existing file.
        render: function that renders the frame as a table.
        json_records: values to write as JSON instead of the rows; None for the rows.

    Raises:
        OutputError: the output cannot be written.
    """

    def format_frame_as_text() -> str:
        match output_format:
            case "json":
                return (
                    format_value_as_json(
                        format_times_as_text(frame).to_dicts()
                        if json_records is None
                        else json_records
                    )
                    + "\n"
                )
            case "csv":
                # for a closed pipe, polars reports only that writing failed
                return frame.write_csv()
            case _:
                return render()

    if output is None:
        if output_format == "csv":
            sys.stdout.write(format_frame_as_text())
        else:
            typer.echo(format_frame_as_text(), nl=False)
        return
    with stage_output_file(output, overwrites=overwrites) as partial:
        if output_format in _BINARY:
            # through memory: for a full disk, polars reports only that computing failed
            written = BytesIO()
            if output_format == "arrow":
                frame.write_ipc(written, compat_level=pl.CompatLevel.oldest())
            else:
                frame.write_parquet(written)
            partial.write_bytes(written.getvalue())
        else:
            partial.write_text(format_frame_as_text(), encoding="utf-8")


def format_times_as_text(frame: pl.DataFrame) -> pl.DataFrame:
    """Format times as ISO 8601 to the nanosecond, where Python's formatting has microseconds."""
    return frame.with_columns(pl.col(pl.Datetime).dt.to_string("iso:strict"))


def print_frame_as_table(frame: pl.DataFrame, row_choice: str = "") -> None:
    """Print first and last rows of a frame as a table that fits the terminal.

    Args:
        frame: the rows.
        row_choice: options that select rows, for the note on how to get the other rows.
    """
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    typer.echo(format_frame_as_table(frame, LIMITS.frame_rows, width), nl=False)
    if frame.height > LIMITS.frame_rows:
        note = f"{frame.height} rows, {LIMITS.frame_rows} shown; {row_choice}--format csv gives all"
        typer.echo(note, err=True)


def format_frame_as_table(frame: pl.DataFrame, max_rows: int, max_width: int | None = None) -> str:
    """Format a frame as text, without truncating or wrapping its cells.

    Args:
        frame: the rows.
        max_rows: most rows to print.
        max_width: characters of a line of the screen; a wider frame is printed in parts, one below
            the other, each with the columns that identify the rows. None for lines of any length.
    """
    if max_width is None:
        return _render_frame_with_polars(frame, max_rows)
    wide = {
        name: _measure_longest_line(_render_frame_with_polars(frame.select(name), max_rows))
        for name in frame.columns
    }
    # local time and seconds identify a row, or else the first column
    names = frame.columns[: 2 if frame.columns[1:2] == ["t_s"] else 1]
    parts: list[list[str]] = [names]
    for name in frame.columns[len(names) :]:
        if parts[-1] != names and sum(wide[each] for each in [*parts[-1], name]) > max_width:
            parts.append([*names])
        parts[-1] = [*parts[-1], name]
    return "\n".join(_render_frame_with_polars(frame.select(part), max_rows) for part in parts)


def _measure_longest_line(text: str) -> int:
    return max(map(cell_len, text.splitlines()), default=0)


def _render_frame_with_polars(frame: pl.DataFrame, max_rows: int) -> str:
    text = StringIO()
    with pl.Config(
        tbl_rows=max_rows,
        tbl_cols=-1,
        tbl_width_chars=LIMITS.text_table_characters,
        fmt_str_lengths=80,
        tbl_hide_column_data_types=True,
        tbl_formatting="NOTHING",
        tbl_hide_dataframe_shape=True,
    ):
        print(frame, file=text)
    return text.getvalue()
