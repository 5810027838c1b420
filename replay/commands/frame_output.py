"""Frames as CSV, JSON or Parquet, on the screen or in a file; tables are each command's own."""

import sys
from collections.abc import Callable
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import polars as pl
import typer

from estimators.errors import OutputError
from recordings.report.atomic_output import whole_file
from replay.commands.print_tables import json_text

#: What `-o` may end in.
_WRITTEN = ("csv", "json", "parquet")
#: Characters of a line of a table.
_NO_LIMIT = 10_000


def format_of(asked: str | None, output: Path | None) -> str:
    """The format that was asked for, or that the output's suffix says, or a table on the screen.

    Raises:
        OutputError: a suffix that says no format, or Parquet to a screen.
    """
    if asked is None and output is not None:
        asked = output.suffix.removeprefix(".")
        if asked not in _WRITTEN:
            raise OutputError(
                f"{output}: no format '{output.suffix}'; use "
                f"{', '.join(f'.{x}' for x in _WRITTEN)}, or say --format"
            )
    if asked == "parquet" and output is None:
        raise OutputError("Parquet is not for a screen: name a file with -o")
    return asked or "table"


def print_frame(
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
        output_format: table, csv, json or parquet.
        output: the file; none for stdout.
        force: whether to replace it.
        table: the frame as a table, lines ended.
        records: what JSON gives instead of the rows as they are.

    Raises:
        OutputError: the output cannot be written.
    """

    def text() -> str:
        match output_format:
            case "json":
                return json_text(frame.to_dicts() if records is None else records) + "\n"
            case "csv":
                # polars says of a closed pipe only that some writing failed
                return frame.write_csv()
            case _:
                return table()

    if output is None:
        if output_format == "csv":
            sys.stdout.write(text())
        else:
            typer.echo(text(), nl=False)
        return
    with whole_file(output, force=force) as partial:
        if output_format == "parquet":
            # by way of memory: polars says of a full disk only that some computing failed
            written = BytesIO()
            frame.write_parquet(written)
            partial.write_bytes(written.getvalue())
        else:
            partial.write_text(text(), encoding="utf-8")


def frame_text(frame: pl.DataFrame, rows: int) -> str:
    """A frame as text, with lines as long as they must be: broken cells cannot be read."""
    text = StringIO()
    with pl.Config(
        tbl_rows=rows,
        tbl_cols=-1,
        tbl_width_chars=_NO_LIMIT,
        fmt_str_lengths=80,
        tbl_hide_column_data_types=True,
        tbl_formatting="NOTHING",
        tbl_hide_dataframe_shape=True,
    ):
        print(frame, file=text)
    return text.getvalue()
