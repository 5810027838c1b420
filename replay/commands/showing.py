"""Stages of a recording as tables, CSV, JSON or Parquet."""

import io
from pathlib import Path

import polars as pl
import typer
from rich.markup import escape

from analysis.schema import FRAMES, Frame
from analysis.stamps import FIRST_DATE_NS
from estimators.errors import RecordingError, nearest
from recordings import read_frame, read_provenance, stages
from recordings.output import check_output, keep_apart
from replay.commands.printing import console, json_text, plain_table, print_line, print_table
from replay.commands.tables import format_of, print_frame

#: A table on a screen shows its ends; --format csv or -o gives every row.
_ROWS_SHOWN = 40
#: Characters of a line of a table.
_NO_LIMIT = 10_000


def list_stages(recording: Path, *, as_json: bool) -> None:
    """Print the recording's stages with their columns, and what was lost on the way to them."""
    held = stages(recording)
    if as_json:
        typer.echo(json_text(held))
        return
    table = plain_table("stage")
    table.add_column("columns", overflow="fold")
    for name, columns in held.items():
        # effort[left] is no markup
        table.add_row(escape(name), escape(" ".join(columns)))
    screen = console()
    print_table(screen, table)
    provenance = read_provenance(recording)
    for loss in provenance.losses:
        print_line(screen, f"lost: {loss}")
    for note in provenance.notes:
        print_line(screen, f"note: {note}")


def show_stage(
    recording: Path,
    stage: str,
    start_s: float | None,
    end_s: float | None,
    output_format: str | None,
    output: Path | None,
    *,
    force: bool,
) -> None:
    """Print one stage, or write it to `output`.

    Args:
        recording: the recording.
        stage: the stage's name.
        start_s: first second of the run.
        end_s: last second of the run.
        output_format: table, csv, json or parquet; None for what the suffix of `output` says, or
            a table on the screen.
        output: a file to write.
        force: whether to replace it.

    Raises:
        RecordingError: the recording has no such stage.
        OutputError: Parquet to a screen, or an output that cannot be written.
    """
    output_format = format_of(output_format, output)
    if output is not None:
        keep_apart(output, [recording])
        check_output(output, force=force)
    held = stages(recording)
    if stage not in held:
        raise RecordingError(f"{recording}: no stage '{stage}'; {nearest(stage, held)}")
    frame = _between(recording, stage, read_frame(recording, stage), start_s, end_s)
    if output is None and output_format == "table":
        _print_table(_readable(recording, stage, frame))
        return
    print_frame(
        frame,
        output_format,
        output,
        force=force,
        table=lambda: _table(_readable(recording, stage, frame), frame.height),
    )


def _between(
    recording: Path, stage: str, frame: pl.DataFrame, start_s: float | None, end_s: float | None
) -> pl.DataFrame:
    """The rows from one second to another, counted from the start of the run."""
    if start_s is None and end_s is None:
        return frame
    column = _time_column(stage)
    if column is None:
        raise RecordingError(f"{recording}: stage '{stage}' has no time to cut by")
    zero_ns = read_provenance(recording).t0_unix_ns if column == "log_time_ns" else 0
    seconds = (pl.col(column) - zero_ns) / 1e9
    if start_s is not None:
        frame = frame.filter(seconds >= start_s)
    if end_s is not None:
        frame = frame.filter(seconds <= end_s)
    return frame


def _time_column(stage: str) -> str | None:
    if stage.startswith("raw/"):
        return "log_time_ns"
    declared: Frame = FRAMES[stage.partition("/")[0]]
    return declared.time_column


def _readable(recording: Path, stage: str, frame: pl.DataFrame) -> pl.DataFrame:
    """Times as a person reads them: seconds from the start, and local where they are dates."""
    column = _time_column(stage)
    if column is None:
        return frame
    known = read_provenance(recording)
    zone = str(known.machine["machine"]["timezone"])
    zero_ns = known.t0_unix_ns
    since_ns = pl.col(column) - (zero_ns if column == "log_time_ns" else 0)
    local = pl.from_epoch(since_ns + zero_ns, time_unit="ns").dt.replace_time_zone("UTC")
    seconds = (since_ns / 1e9).alias("t_s")
    rest = pl.exclude(column, "header_stamp_ns")
    if zero_ns < FIRST_DATE_NS:
        return frame.select(seconds, rest)
    return frame.select(
        local.dt.convert_time_zone(zone).dt.strftime("%F %T%.3f").alias(f"local ({zone})"),
        seconds,
        rest,
    )


def _print_table(frame: pl.DataFrame) -> None:
    typer.echo(_table(frame, _ROWS_SHOWN), nl=False)
    if frame.height > _ROWS_SHOWN:
        typer.echo(
            f"{frame.height} rows, {_ROWS_SHOWN} shown; --from and --to choose, "
            "--format csv gives all",
            err=True,
        )


def _table(frame: pl.DataFrame, rows: int) -> str:
    """A frame as text, with lines as long as they must be: broken cells cannot be read."""
    text = io.StringIO()
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
