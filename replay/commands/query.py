"""`payscope query`: SQL over logs, recordings, ledgers and the results of a fleet."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from replay.commands.common_options import (
    FormatOption,
    LogKeys,
    OutputFile,
    TimeColumn,
    TimeUnit,
)

if TYPE_CHECKING:
    from replay.query.named_tables import NamedTables
    from replay.query.run_query import Query

#: Formats that are written as rows are computed.
_STREAMED: Final = ("csv", "parquet", "arrow")


def command(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG... SQL",
            help="Logs, recordings, a review or ledger, results of a fleet; last, one SELECT.",
        ),
    ],
    tables: Annotated[
        bool, typer.Option("--tables", help="List the tables and their columns; needs no SELECT.")
    ] = False,
    merge_within_s: Annotated[
        float | None,
        typer.Option(
            "--moments",
            metavar="SECONDS",
            min=0.0,
            help="Print moments instead of rows: rows at most SECONDS apart are merged.",
        ),
    ] = None,
    output_format: FormatOption = None,
    output: OutputFile = None,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    time: TimeColumn = None,
    time_unit: TimeUnit = None,
    keys: LogKeys = None,
) -> None:
    """Query topics of logs, frames of recordings, ledgers and results by SQL.

    Each topic is a table, named in double quotes or as one word: "/imu/data" is imu_data. A row
    with a time is a moment that `view --at` opens.
    """
    from replay.commands.common_options import make_time_axis_from_options
    from replay.commands.frame_output import choose_output_format
    from replay.query.named_tables import open_named_tables
    from replay.query.run_query import prepare_query_of_sources

    axis = make_time_axis_from_options(time, time_unit, keys)
    if tables:
        _print_available_tables(open_named_tables(sources, axis), as_json=output_format == "json")
        return
    if len(sources) == 1:
        raise typer.BadParameter(
            'name a log or recording, then one SELECT: payscope query shift.bag "SELECT …"; '
            "--tables lists the tables"
        )
    chosen = choose_output_format(output_format and output_format.value, output)
    asked = prepare_query_of_sources(sources[:-1], sources[-1], axis)
    try:
        if output is not None and merge_within_s is None and chosen in _STREAMED:
            asked.write_rows_to_file(output, chosen, overwrites=force)
        else:
            _print_or_write_query_rows(asked, merge_within_s, chosen, output, overwrites=force)
    finally:
        for loss in dict.fromkeys(map(str, asked.named.losses)):
            typer.echo(f"lost: {loss}", err=True)


def _print_or_write_query_rows(
    query: "Query",
    merge_within_s: float | None,
    output_format: str,
    output_path: Path | None,
    *,
    overwrites: bool,
) -> None:
    from recordings.report.atomic_output import require_writable_output
    from replay.commands.frame_output import (
        format_frame_as_table,
        print_frame_as_table,
        print_or_write_frame,
    )

    if output_path is not None:
        require_writable_output(output_path, overwrites=overwrites)
    rows = query.collect_rows(merge_within_s)
    if output_format == "table" and output_path is None:
        print_frame_as_table(rows)
        opens = query.format_viewer_command_of_rows(rows)
        if opens and merge_within_s is None:
            typer.echo(f"the first row in the viewer: {opens}", err=True)
        return
    print_or_write_frame(
        rows,
        output_format,
        output_path,
        overwrites=overwrites,
        render=lambda: format_frame_as_table(rows, rows.height),
    )


def _print_available_tables(named_tables: "NamedTables", *, as_json: bool) -> None:
    from rich.markup import escape

    from estimators.errors import PayscopeError
    from replay.commands.print_tables import (
        make_plain_table,
        make_stdout_console,
        print_json,
        print_table_uncut,
    )

    columns: dict[str, list[str]] = {}
    for name, table in named_tables.tables.items():
        if name not in named_tables.words.values() or name in named_tables.words:
            try:
                columns[name] = list(table().collect_schema())
            except PayscopeError as error:  # other tables may be readable
                typer.echo(f"payscope: {error}", err=True)
    if as_json:
        print_json(columns)
        return
    shown = make_plain_table("table")
    shown.add_column("in a word", no_wrap=True)
    shown.add_column("columns", overflow="fold")
    for name, has in columns.items():
        shown.add_row(escape(name), named_tables.words.get(name, ""), escape(" ".join(has)))
    print_table_uncut(make_stdout_console(), shown)
