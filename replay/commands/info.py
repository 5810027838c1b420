"""`payscope info`: describe the contents of a log."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime, tzinfo
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, NamedTuple

import typer

from replay.commands.common_options import LogKeys, TimeColumn, TimeUnit

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from replay.init.describe_log import LogInfo

_NO_CRC: Final = "no CRC to compare"


def command(
    logs: Annotated[list[Path], typer.Argument(help="Logs to describe.")],
    time: TimeColumn = None,
    time_unit: TimeUnit = None,
    keys: LogKeys = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Read and decode everything; exit 1 if anything is missing."),
    ] = False,
    fields: Annotated[
        bool,
        typer.Option("--fields", help="Describe every message field too, by reading all messages."),
    ] = False,
    timezone: Annotated[str, typer.Option(help="The time zone of the times shown.")] = "UTC",
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Show the topics, types, counts, rates and gaps of logs, from the index where there is one.

    Without --check, only damage in the parts read is reported. With it, every message of every
    topic is read and decoded, every CRC compared and the index checked against the records; the
    exit status is 1 if anything is missing or damaged.
    """
    from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

    from estimators.errors import LogError
    from replay.commands.common_options import make_time_axis_from_options
    from replay.commands.print_tables import make_stdout_console, print_json
    from replay.init.describe_log import describe_log_by_index
    from replay.logs import open_log

    try:
        zone = ZoneInfo(timezone)
    except (ZoneInfoNotFoundError, ValueError):
        raise typer.BadParameter(
            f"no time zone '{timezone}'; use a name like America/Santiago or UTC"
        ) from None
    axis = make_time_axis_from_options(time, time_unit, keys)
    described: list[object] = []
    faults: list[LogError] = []
    is_whole = True
    for path in logs:
        try:
            with open_log(path, time=axis) as log, _show_reading_progress(is_log_checked=check):
                shown = describe_log_by_index(log, is_log_checked=check, are_fields_profiled=fields)
        except LogError as error:
            # describe the other logs nevertheless
            faults.append(error)
            continue
        is_whole = is_whole and shown.is_read_without_loss is not False
        if as_json:
            described.append(shown.to_dict())
        else:
            print_log_info(shown, zone, make_stdout_console())
            typer.echo()
    if as_json and described:
        print_json(described[0] if len(logs) == 1 else described)
    for error in faults[:-1]:
        typer.echo(f"payscope: {error}", err=True)
    if faults:
        raise faults[-1]
    if not is_whole:
        raise typer.Exit(1)


def _show_reading_progress(*, is_log_checked: bool) -> AbstractContextManager[object]:
    """Context that shows progress if the whole log is read; reading an index takes no time."""
    if not is_log_checked:
        return nullcontext()
    from replay.commands.progress_bar import StageProgress

    return StageProgress(1)


def print_log_info(log_info: "LogInfo", time_zone: tzinfo, console: "Console") -> None:
    """Print a log's description, with its start in local time of `time_zone`."""
    from replay.commands.print_tables import print_line, print_rows_as_table, print_table_uncut

    for line in _iter_log_head_lines(log_info, time_zone):
        print_line(console, line)
    print_table_uncut(console, _make_topic_table(log_info))
    if log_info.fields:
        print_rows_as_table(_FIELD_TITLES, _make_field_rows(log_info), _LEFT)
    for note in log_info.notes:
        print_line(console, f"note: {note}")
    for mark, line in iter_check_result_lines(log_info):
        print_line(console, line, mark)
    for line in _iter_log_problems(log_info):
        print_line(console, line, "[yellow]![/] ")


def _iter_log_head_lines(log_info: "LogInfo", time_zone: tzinfo) -> Iterator[str]:
    from estimators.errors import format_count

    yield f"{log_info.path}: {log_info.format}, {log_info.size_bytes / 1e6:,.3f} MB"
    if log_info.start_ns is None or log_info.duration_s is None:
        yield "no messages"
        return
    count = format_count(log_info.messages, "message")
    start = _format_log_time(log_info.start_ns, time_zone)
    yield f"from {start}, {log_info.duration_s:,.3f} s, {count}"


class _MarkedLine(NamedTuple):
    """A line, and the markup of the mark before it."""

    mark: str
    text: str


def iter_check_result_lines(log_info: "LogInfo") -> Iterator[_MarkedLine]:
    """Yield the outcome of --check as mark and text; nothing for a log that was not checked."""
    from estimators.errors import format_count

    if log_info.checked is None:
        return
    found, done = (
        ("[green]checked, complete[/]", "decoded")
        if log_info.is_read_without_loss
        else ("[red]checked, incomplete[/]", "read")
    )
    agree = "agrees" if log_info.checked.crcs == 1 else "agree"
    crcs = (
        f"{format_count(log_info.checked.crcs, 'CRC')} {agree}"
        if log_info.checked.crcs
        else _NO_CRC
    )
    yield _MarkedLine(
        found,
        f": {format_count(log_info.checked.messages, 'message')} "
        f"({log_info.checked.message_bytes / 1e6:,.3f} MB) {done}, {crcs}, "
        f"in {log_info.check_s:.2f} s",
    )


def _format_log_time(stamp_ns: int, time_zone: tzinfo) -> str:
    from analysis.stages.signals.timestamps import FIRST_DATE_NS

    seconds = f"{stamp_ns / 1e9:.3f} s"
    if stamp_ns < FIRST_DATE_NS:
        return f"{seconds} of the log's own clock"
    local = datetime.fromtimestamp(stamp_ns // 10**9, time_zone)
    return f"{local:%Y-%m-%d %H:%M:%S %Z} ({seconds})"


def _make_topic_table(log_info: "LogInfo") -> "Table":
    from rich.markup import escape
    from rich.table import Table

    from estimators.errors import join_to_one_line

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("topic", overflow="fold")
    table.add_column("type", overflow="fold")
    for title in ("messages", "from s", "to s", "Hz", "longest gap s"):
        table.add_column(title, justify="right", no_wrap=True)
    for row in log_info.topics.iter_rows(named=True):
        table.add_row(
            escape(join_to_one_line(row["topic"])),
            escape(join_to_one_line(row["type"])),
            f"{row['messages']:,}",
            _format_seconds_since_start(row["start_ns"], log_info.start_ns),
            _format_seconds_since_start(row["end_ns"], log_info.start_ns),
            _format_number_or_dash(row["rate_hz"]),
            _format_number_or_dash(row["longest_gap_s"]),
        )
    return table


_FIELD_TITLES = ("field", "unit", "Hz", "min", "median", "max", "course")
#: Left-aligned columns: field, unit and sparkline.
_LEFT = (0, 1, 6)


def _make_field_rows(log_info: "LogInfo") -> list[tuple[str, ...]]:
    from estimators.errors import join_to_one_line

    several = len({each.topic for each in log_info.fields}) > 1
    rows: list[tuple[str, ...]] = []
    for each in log_info.fields:
        name = f"{each.topic} {each.field}" if several else each.field
        numbers = (each.rate_hz, each.low, each.middle, each.high)
        rows.append(
            (
                join_to_one_line(name),
                each.unit or "–",
                *map(_format_number_or_dash, numbers),
                each.course,
            )
        )
    return rows


def _iter_log_problems(log_info: "LogInfo") -> Iterator[str]:
    topics_with_losses = {loss.topic for loss in log_info.losses}
    for loss in log_info.losses:
        # the file of a topic's loss is stated only for a part of a log
        is_of_log = bool(loss.topic) and loss.source == log_info.path.name
        yield f"{loss.topic}: {loss.what}" if is_of_log else str(loss)
    for row in log_info.topics.iter_rows(named=True):
        if row["problem"] and row["topic"] not in topics_with_losses:
            yield f"{row['topic']} (no messages): {row['problem']}"
        if row["decoder"] == "rosbags":
            yield (
                f"{row['topic']}: read message by message with rosbags, which is slow: "
                f"{row['type']} has a field type that the columnar decoder does not support"
            )


def _format_seconds_since_start(stamp_ns: int | None, start_ns: int | None) -> str:
    if stamp_ns is None or start_ns is None:
        return "–"
    return f"{(stamp_ns - start_ns) / 1e9:.3f}"


def _format_number_or_dash(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
