"""`payscope convert`: convert a log to Parquet by topic."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.commands.common_options import LogKeys, TimeColumn, TimeUnit

if TYPE_CHECKING:
    from rich.console import Console

    from replay.convert.convert_log import Conversion


def command(
    log: Annotated[Path, typer.Argument(help="The log.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the Parquet files.")
    ],
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="Convert this topic alone; repeatable.")
    ] = None,
    time: TimeColumn = None,
    time_unit: TimeUnit = None,
    keys: LogKeys = None,
    force: Annotated[bool, typer.Option(help="Replace an existing converted log.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Convert a log to Parquet, by topic; payscope and other tools read DIR as a log.

    DIR appears once it is complete. The same command resumes an interrupted conversion.
    """
    from replay.commands.common_options import make_time_axis_from_options
    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.commands.progress_bar import StageProgress
    from replay.convert.convert_log import convert_log
    from replay.logs import open_log

    with (
        open_log(log, time=make_time_axis_from_options(time, time_unit, keys)) as opened,
        StageProgress(1) as stages,
    ):
        made = convert_log(opened, output, topics, overwrites=force, on_span=stages.begin_stage)
    if as_json:
        print_json(made.to_dict())
    else:
        _print_conversion(made, make_stdout_console())


def _print_conversion(conversion: "Conversion", console: "Console") -> None:
    from rich.markup import escape

    from estimators.errors import join_to_one_line
    from replay.commands.print_tables import make_plain_table, print_line, print_table_uncut

    table = make_plain_table("topic", "rows", "MB", "files")
    for topic in conversion.to_dict()["topics"]:
        files = (
            f"{topic['folder']}/*.parquet" if topic["folder"] else join_to_one_line(topic["fault"])
        )
        size = f"{topic['size_bytes'] / 1e6:,.3f}"
        table.add_row(
            escape(join_to_one_line(topic["topic"])), f"{topic['rows']:,}", size, escape(files)
        )
    print_table_uncut(console, table)
    taken = (
        f", {conversion.resumed_spans} of {conversion.spans} spans already converted"
        if conversion.resumed_spans
        else ""
    )
    print_line(
        console,
        f"{conversion.folder}: {conversion.row_count:,} rows, "
        f"{conversion.size_bytes / 1e6:,.3f} MB{taken}",
    )
    for loss in conversion.losses:
        print_line(console, f"lost: {loss}")
