"""What is in a log: the answer of `payscope info`, for people and for machines."""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import datetime, tzinfo
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from analysis.run import Loss
from analysis.stamps import FIRST_DATE_NS
from estimators.errors import counted, one_line
from replay.readers import Checked, Log, format_name

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_NO_CRC: Final = "no CRC to compare"


@dataclass(frozen=True, slots=True, eq=False)
class LogInfo:
    """What is in a log. Times are ns of its own clock, null in a log without messages."""

    path: Path
    format: str
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    duration_s: float | None
    messages: int
    #: a row a topic, as `Log.topics` gives it
    topics: pl.DataFrame
    losses: tuple[Loss, ...]
    #: what was read to check it; None where only the index was looked at
    checked: Checked | None = None
    check_s: float | None = None

    @property
    def is_whole(self) -> bool | None:
        """Whether everything was read and nothing lost; None where it was not checked."""
        return None if self.checked is None else not self.losses

    def to_dict(self) -> dict[str, Any]:
        """The same as plain JSON values."""
        return {
            "path": str(self.path),
            "format": self.format,
            "size_bytes": self.size_bytes,
            "start_ns": self.start_ns,
            "end_ns": self.end_ns,
            "duration_s": self.duration_s,
            "messages": self.messages,
            "topics": self.topics.to_dicts(),
            "losses": [loss.model_dump() for loss in self.losses],
            "check": None
            if self.checked is None
            else {"whole": self.is_whole, **asdict(self.checked), "seconds": self.check_s},
        }


def describe(log: Log, *, check: bool = False) -> LogInfo:
    """Describe a log by its index, without decoding its messages.

    Args:
        log: opened.
        check: whether to read and decode everything as well (`Log.check`).

    Raises:
        LogError: a table whose time column holds no times.
    """
    topics = log.topics()
    begun = time.perf_counter()
    checked = log.check() if check else None
    ends: dict[str, Any] = topics.select(
        pl.col("start_ns").min(), pl.col("end_ns").max(), pl.col("messages").sum()
    ).row(0, named=True)
    start, end = ends["start_ns"], ends["end_ns"]
    return LogInfo(
        path=log.path,
        format=format_name(log.path),
        size_bytes=sum(file.stat().st_size for file in log.files),
        start_ns=start,
        end_ns=end,
        duration_s=None if start is None else (end - start) / 1e9,
        messages=ends["messages"],
        topics=topics,
        losses=log.losses(),
        checked=checked,
        check_s=time.perf_counter() - begun if check else None,
    )


def show(info: LogInfo, zone: tzinfo, screen: "Console") -> None:
    """Print a log's description, its start in local time of `zone`."""
    from replay.commands.printing import print_line, print_table

    for line in _head(info, zone):
        print_line(screen, line)
    print_table(screen, _topic_table(info))
    for mark, line in _verdict(info):
        print_line(screen, line, mark)
    for line in _troubles(info):
        print_line(screen, line, "[yellow]![/] ")


def _head(info: LogInfo, zone: tzinfo) -> Iterator[str]:
    yield f"{info.path}: {info.format}, {info.size_bytes / 1e6:,.3f} MB"
    if info.start_ns is None or info.duration_s is None:
        yield "no messages"
        return
    count = counted(info.messages, "message")
    yield f"from {_when(info.start_ns, zone)}, {info.duration_s:,.3f} s, {count}"


def _verdict(info: LogInfo) -> Iterator[tuple[str, str]]:
    """What a check found, in a line (mark and text) that no log has which was not checked."""
    if info.checked is None:
        return
    found, done = (
        ("[green]checked and whole[/]", "decoded")
        if info.is_whole
        else ("[red]checked and not whole[/]", "read")
    )
    agree = "agrees" if info.checked.crcs == 1 else "agree"
    crcs = f"{counted(info.checked.crcs, 'CRC')} {agree}" if info.checked.crcs else _NO_CRC
    yield (
        found,
        f": {counted(info.checked.messages, 'message')} "
        f"({info.checked.message_bytes / 1e6:,.3f} MB) {done}, {crcs}, in {info.check_s:.2f} s",
    )


def _when(stamp_ns: int, zone: tzinfo) -> str:
    seconds = f"{stamp_ns / 1e9:.3f} s"
    if stamp_ns < FIRST_DATE_NS:
        return f"{seconds} of the log's own clock"
    local = datetime.fromtimestamp(stamp_ns // 10**9, zone)
    return f"{local:%Y-%m-%d %H:%M:%S %Z} ({seconds})"


def _topic_table(info: LogInfo) -> "Table":
    from rich.markup import escape
    from rich.table import Table

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
            _seconds(row["start_ns"], info.start_ns),
            _seconds(row["end_ns"], info.start_ns),
            _number(row["rate_hz"]),
            _number(row["longest_gap_s"]),
        )
    return table


def _troubles(info: LogInfo) -> Iterator[str]:
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
                f"{row['type']} has a field that columns are not made of"
            )


def _seconds(stamp_ns: int | None, start_ns: int | None) -> str:
    if stamp_ns is None or start_ns is None:
        return "–"
    return f"{(stamp_ns - start_ns) / 1e9:.3f}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
