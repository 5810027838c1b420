"""Place logs whose times have no date on a common time line: consecutive, or in parallel."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final, NamedTuple, Self

import numpy as np
import polars as pl

from estimators.errors import LogError
from replay.inputs.input_limits import LIMITS
from replay.logs import TABLE, Log

#: A day in ns.
_DAY_NS: Final = 86_400 * 10**9
#: Pairs of a topic and a field that channels name.
_TopicsAndFields = frozenset[tuple[str, str]]


def compute_log_offsets_ns(
    logs: Sequence[Log], wanted_fields: Mapping[str, Sequence[str]]
) -> dict[Log, int]:
    """Compute the offset of each log on the common time line, in ns.

    Logs that count from 0 are consecutive, in the given order, if they have the same fields, and
    parallel if they share none. So are logs whose counter restarts, or whose times of day pass
    midnight, from one log to the next. Logs with dated times have an offset of 0.

    Args:
        logs: logs in order.
        wanted_fields: fields that the channels name, by topic.

    Raises:
        LogError: logs that count from 0 share only some of the fields.
    """
    none = dict.fromkeys(logs, 0)
    if len(logs) < 2:
        return none
    tables = {log: log.topics().filter(pl.col("topic").is_in(list(wanted_fields))) for log in logs}
    tables = {log: table.filter(pl.col("messages") > 0) for log, table in tables.items()}
    if any(table.is_empty() for table in tables.values()):
        return none
    starts_ns = {log: int(table["start_ns"].to_numpy().min()) for log, table in tables.items()}
    if not all(0 <= start_ns < LIMITS.undated_ns for start_ns in starts_ns.values()):
        return none
    # a log that is given twice counts once
    if len({log.digests for log in logs}) < len(logs):
        return none
    has = [_find_topics_with_wanted_fields(table, wanted_fields) for table in tables.values()]
    if not any(one & other for one, other in combinations(has, 2)):
        return none
    if len(set(has)) > 1:
        if any(start_ns >= LIMITS.from_zero_ns for start_ns in starts_ns.values()):
            return none
        raise LogError(
            f"{', '.join(str(log.path) for log in logs)}: the times of each begin at 0, and they "
            "share only some channels, so their order is unknown; give consecutive logs with the "
            "same channels, parallel logs with no common channel, or logs with times since 1970"
        )
    return _place_logs_in_given_order(tables, starts_ns) or none


def sort_logs_by_time(logs: Sequence[Log], wanted_fields: Mapping[str, Sequence[str]]) -> list[Log]:
    """Sort logs by their first messages, so that the order of arguments does not matter.

    Logs without dates that follow one another as given keep that order. Times of day that end at
    midnight and begin there again, with half a day between, are of two days.

    Args:
        logs: logs in the given order.
        wanted_fields: fields that the channels name, by topic.
    """
    if any(compute_log_offsets_ns(logs, wanted_fields).values()):
        return list(logs)
    tables = {log: log.topics() for log in logs}
    spans_ns = {
        log: (table["start_ns"].min() or 0, table["end_ns"].max() or 0)
        for log, table in tables.items()
    }
    ordered = sorted(spans_ns, key=lambda log: (spans_ns[log][0], str(log.path)))
    if len(ordered) < 2:
        return ordered
    starts_ns, ends_ns = np.array([spans_ns[log] for log in ordered]).T
    between_ns = starts_ns[1:] - np.maximum.accumulate(ends_ns)[:-1]
    at_midnight = 0 <= starts_ns[0] + _DAY_NS - max(ends_ns) < LIMITS.around_midnight_ns
    if at_midnight and max(between_ns) > _DAY_NS // 2:
        second_day = int(np.argmax(between_ns)) + 1
        return [*ordered[second_day:], *ordered[:second_day]]
    return ordered


def _place_logs_in_given_order(
    tables: Mapping[Log, pl.DataFrame], starts_ns: Mapping[Log, int]
) -> dict[Log, int] | None:
    """Offsets by which logs follow one another as given; None if their times have another order."""
    lattice = _SampleLattice.from_sample_times(next(iter(tables.values())))
    ends_ns = {log: int(table["end_ns"].to_numpy().max()) for log, table in tables.items()}
    found: dict[Log, int] = {}
    previous, last_ns = next(iter(tables)), 0
    for log, table in tables.items():
        restarts = starts_ns[log] < LIMITS.from_zero_ns and log is not previous
        if starts_ns[log] >= starts_ns[previous] and not restarts:
            found[log] = found.get(previous, 0)
        elif 0 <= starts_ns[previous] - ends_ns[log] <= _DAY_NS // 2:
            return None  # one counter, given in another order
        elif 0 <= starts_ns[log] + found[previous] + _DAY_NS - last_ns < LIMITS.around_midnight_ns:
            found[log] = found[previous] + _DAY_NS
        elif restarts:
            slowest_s = LIMITS.between_logs_periods / float(
                table["rate_hz"].fill_null(1.0).to_numpy().min()
            )
            between_ns = round(max(LIMITS.between_logs_s, slowest_s) * 1e9)
            found[log] = lattice.find_next_offset_on_lattice_ns(last_ns + between_ns, table)
        else:
            return None
        previous, last_ns = log, max(last_ns, found[log] + ends_ns[log])
    return found


class _SampleLattice(NamedTuple):
    """Stamps of the first log's slowest topic, continued at its period.

    The grid has the phase of this lattice. A log off the lattice would be interpolated, which
    reduces the noise of its samples, while the noise correction is common to all logs.
    """

    topic: str
    start_ns: int
    period_ns: float

    @classmethod
    def from_sample_times(cls, table: pl.DataFrame) -> Self:
        slowest = table.sort("rate_hz", "topic", nulls_last=True).row(0, named=True)
        # six digits, as of the grid's own rate
        rate_hz = float(f"{slowest['rate_hz'] or 1.0:.6g}")
        return cls(slowest["topic"], int(slowest["start_ns"]), 1e9 / rate_hz)

    def find_next_offset_on_lattice_ns(self, min_offset_ns: int, table: pl.DataFrame) -> int:
        """Find the first offset from `min_offset_ns` with a log's first stamp on the lattice."""
        (start_ns,) = table.filter(pl.col("topic") == self.topic)["start_ns"]
        between_ns = int(start_ns) - self.start_ns
        periods = math.ceil(
            (min_offset_ns + between_ns) / self.period_ns - LIMITS.same_phase_periods
        )
        return round(periods * self.period_ns) - between_ns


def compute_log_starts_ns(
    logs: Sequence[Log], wanted_fields: Mapping[str, Sequence[str]], t0_unix_ns: int
) -> dict[Log, int]:
    """Compute the start of each log in ns since the first aligned sample, ascending.

    Args:
        logs: logs of one time line.
        wanted_fields: fields that the channels name, by topic.
        t0_unix_ns: Unix time of the first aligned sample.
    """
    later = compute_log_offsets_ns(logs, wanted_fields)
    found: dict[Log, int] = {}
    for log in logs:
        topics = log.topics()
        first = topics.filter(pl.col("topic").is_in(list(wanted_fields)))["start_ns"].min()
        if isinstance(first, int):
            found[log] = first + later[log] - t0_unix_ns
    return dict(sorted(found.items(), key=lambda each: each[1]))


def shift_message_times(frame: pl.DataFrame, offset_ns: int) -> pl.DataFrame:
    """Shift header stamps and log times of messages by an offset."""
    if not offset_ns:
        return frame
    header = pl.col("header_stamp_ns")
    return frame.with_columns(
        pl.col("log_time_ns") + offset_ns,
        # a header stamp of 0 means no stamp
        pl.when(header != 0).then(header + offset_ns).otherwise(header).alias("header_stamp_ns"),
    )


def describe_log_order(offsets_ns: Mapping[Log, int]) -> list[str]:
    """Describe the assumed order of the logs in a note; empty if no log is shifted."""
    if not any(offsets_ns.values()):
        return []
    names = ", ".join(log.path.name for log in offsets_ns)
    days = all(offset_ns % _DAY_NS == 0 for offset_ns in offsets_ns.values())
    why = "the times have no date and pass midnight" if days else "the times begin again at 0"
    return [f"{why}: the logs are taken to follow one another as given ({names})"]


def _find_topics_with_wanted_fields(
    topic_table: pl.DataFrame, wanted_fields: Mapping[str, Sequence[str]]
) -> _TopicsAndFields:
    """Find the wanted topics of a log; for a table, the wanted columns that it has."""
    return frozenset(
        (topic, field)
        for topic, fields in topic_table.select("topic", "fields").iter_rows()
        for field in (set(wanted_fields[topic]) & set(fields or []) if topic == TABLE else [""])
    )
