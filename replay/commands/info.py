"""`payscope info`: what is in a log."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime, tzinfo
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

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
        typer.Option("--fields", help="Describe every field of messages too: reads all of them."),
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
    from replay.init.describe_log import describe_log
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
            with open_log(path, time=axis) as log, _show_progress(check=check):
                shown = describe_log(log, check=check, fields=fields)
        except LogError as error:
            # the other logs are still worth describing
            faults.append(error)
            continue
        is_whole = is_whole and shown.is_whole is not False
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


def _show_progress(*, check: bool) -> AbstractContextManager[object]:
    """Progress of reading everything; an index alone is read before it is seen."""
    if not check:
        return nullcontext()
    from replay.commands.progress_bar import StageProgress

    return StageProgress(1)


def print_log_info(info: "LogInfo", zone: tzinfo, screen: "Console") -> None:
    """Print a log's description, its start in local time of `zone`."""
    from replay.commands.print_tables import print_line, print_rows, print_table

    for line in _make_head_lines(info, zone):
        print_line(screen, line)
    print_table(screen, _make_topic_table(info))
    if info.fields:
        print_rows(_FIELD_TITLES, _make_field_rows(info), _LEFT)
    for note in info.notes:
        print_line(screen, f"note: {note}")
    for mark, line in _make_verdict_lines(info):
        print_line(screen, line, mark)
    for line in _describe_problems(info):
        print_line(screen, line, "[yellow]![/] ")


def _make_head_lines(info: "LogInfo", zone: tzinfo) -> Iterator[str]:
    from estimators.errors import counted

    yield f"{info.path}: {info.format}, {info.size_bytes / 1e6:,.3f} MB"
    if info.start_ns is None or info.duration_s is None:
        yield "no messages"
        return
    count = counted(info.messages, "message")
    yield f"from {_format_log_time(info.start_ns, zone)}, {info.duration_s:,.3f} s, {count}"


def _make_verdict_lines(info: "LogInfo") -> Iterator[tuple[str, str]]:
    """Yield the outcome of --check as mark and text; nothing for a log that was not checked."""
    from estimators.errors import counted

    if info.checked is None:
        return
    found, done = (
        ("[green]checked, complete[/]", "decoded")
        if info.is_whole
        else ("[red]checked, incomplete[/]", "read")
    )
    agree = "agrees" if info.checked.crcs == 1 else "agree"
    crcs = f"{counted(info.checked.crcs, 'CRC')} {agree}" if info.checked.crcs else _NO_CRC
    yield (
        found,
        f": {counted(info.checked.messages, 'message')} "
        f"({info.checked.message_bytes / 1e6:,.3f} MB) {done}, {crcs}, in {info.check_s:.2f} s",
    )


def _format_log_time(stamp_ns: int, zone: tzinfo) -> str:
    from analysis.stages.signals.timestamps import FIRST_DATE_NS

    seconds = f"{stamp_ns / 1e9:.3f} s"
    if stamp_ns < FIRST_DATE_NS:
        return f"{seconds} of the log's own clock"
    local = datetime.fromtimestamp(stamp_ns // 10**9, zone)
    return f"{local:%Y-%m-%d %H:%M:%S %Z} ({seconds})"


def _make_topic_table(info: "LogInfo") -> "Table":
    from rich.markup import escape
    from rich.table import Table

    from estimators.errors import one_line

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("topic", overflow="fold")
    table.add_column("type", overflow="fold")
    for title in ("messages", "from s", "to s", "Hz", "longest gap s"):
        table.add_column(title, justify="right", no_wrap=True)
    for row in info.topics.iter_rows(named=True):
        table.add_row(
            escape(one_line(row["topic"])),
            escape(one_line(row["type"])),
            f"{row['messages']:,}",
            _format_seconds(row["start_ns"], info.start_ns),
            _format_seconds(row["end_ns"], info.start_ns),
            _format_number(row["rate_hz"]),
            _format_number(row["longest_gap_s"]),
        )
    return table


_FIELD_TITLES = ("field", "unit", "Hz", "min", "median", "max", "course")
#: The field, its unit and its course.
_LEFT = (0, 1, 6)


def _make_field_rows(info: "LogInfo") -> list[tuple[str, ...]]:
    from estimators.errors import one_line

    several = len({each.topic for each in info.fields}) > 1
    rows: list[tuple[str, ...]] = []
    for each in info.fields:
        name = f"{each.topic} {each.field}" if several else each.field
        numbers = (each.rate_hz, each.low, each.middle, each.high)
        rows.append((one_line(name), each.unit or "–", *map(_format_number, numbers), each.course))
    return rows


def _describe_problems(info: "LogInfo") -> Iterator[str]:
    told = {loss.topic for loss in info.losses}
    for loss in info.losses:
        # whose topic it is needs no saying but of a part of a log
        is_of_log = bool(loss.topic) and loss.source == info.path.name
        yield f"{loss.topic}: {loss.what}" if is_of_log else str(loss)
    for row in info.topics.iter_rows(named=True):
        if row["problem"] and row["topic"] not in told:
            yield f"{row['topic']} (no messages): {row['problem']}"
        if row["decoder"] == "rosbags":
            yield (
                f"{row['topic']}: read message by message with rosbags, which is slow: "
                f"{row['type']} has a field type that the columnar decoder does not support"
            )


def _format_seconds(stamp_ns: int | None, start_ns: int | None) -> str:
    if stamp_ns is None or start_ns is None:
        return "–"
    return f"{(stamp_ns - start_ns) / 1e9:.3f}"


def _format_number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
