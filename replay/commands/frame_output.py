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
from recordings.report.atomic_output import stage_output_file
from replay.commands.print_tables import format_value_as_json
from replay.commands.screen_limits import LIMITS

#: What `-o` may end in.
_WRITTEN: Final = ("csv", "json", "parquet", "arrow")
#: Bytes that no screen shows.
_BINARY: Final = ("parquet", "arrow")


def choose_output_format(requested_format: str | None, output_path: Path | None) -> str:
    """Requested format, else that of the output's suffix, else a table.

    Raises:
        OutputError: unknown suffix, or a binary format for a terminal.
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
    force: bool,
    render: Callable[[], str],
    json_records: Any = None,
) -> None:
    """Print a frame, or write it to a file.

    Args:
        frame: the rows.
        output_format: table, csv, json, parquet or arrow.
        output: file to write; None for stdout.
        force: whether to replace an existing file.
        render: renders the frame as a table.
        json_records: values for JSON instead of the rows.

    Raises:
        OutputError: the output cannot be written.
    """

    def frame_as_text() -> str:
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
                # polars says of a closed pipe only that some writing failed
                return frame.write_csv()
            case _:
                return render()

    if output is None:
        if output_format == "csv":
            sys.stdout.write(frame_as_text())
        else:
            typer.echo(frame_as_text(), nl=False)
        return
    with stage_output_file(output, force=force) as partial:
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


def format_times_as_text(frame: pl.DataFrame) -> pl.DataFrame:
    """Times as ISO 8601 text to the nanosecond; Python's own formatting stops at microseconds."""
    return frame.with_columns(pl.col(pl.Datetime).dt.to_string("iso:strict"))


def print_frame_as_table(frame: pl.DataFrame, row_choice: str = "") -> None:
    """Print the ends of a frame as a table that fits the terminal, and how to get the others.

    Args:
        frame: the rows.
        row_choice: options that choose rows, for the note on those that are not shown.
    """
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    typer.echo(format_frame_as_table(frame, LIMITS.frame_rows, width), nl=False)
    if frame.height > LIMITS.frame_rows:
        note = f"{frame.height} rows, {LIMITS.frame_rows} shown; {row_choice}--format csv gives all"
        typer.echo(note, err=True)


def format_frame_as_table(frame: pl.DataFrame, max_rows: int, max_width: int | None = None) -> str:
    """A frame as text, its cells whole: broken ones cannot be read.

    Args:
        frame: the rows.
        max_rows: most rows to print.
        max_width: columns of a screen; a wider frame stands there in parts, one below the other,
            each behind the columns that say what its rows are. None for lines as long as they must
            be.
    """
    if max_width is None:
        return _render_frame_with_polars(frame, max_rows)
    wide = {
        name: _measure_longest_line(_render_frame_with_polars(frame.select(name), max_rows))
        for name in frame.columns
    }
    # local time and seconds say where a row is, or what stands first
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
