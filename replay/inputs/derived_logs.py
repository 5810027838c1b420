"""Logs without files of their own: cached, part of another log, parallel tables, or simulated."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import polars as pl

from analysis.model.loss import Loss
from analysis.model.machine import Channel, Machine
from estimators.errors import LogError, suggest_choice
from replay.logs import TABLE, Log, LogCheck

if TYPE_CHECKING:
    # not loaded with the pipeline
    from analysis.simulation import SimulatedLog

#: Prefix of the topic of a table that is read in parallel with others.
_NAMED: Final = f"{TABLE}/"
_STAMPS = ("log_time_ns", "header_stamp_ns")
_FORMAT = "simulation in memory"


class DerivedLog(Log):
    """A log that reads from another one, which stays open when this one is closed."""

    def __init__(self, log: Log) -> None:
        """Wrap an open log."""
        super().__init__(log.path, log.format)
        self._log = log

    @property
    def files(self) -> tuple[Path, ...]:
        """No files, since a derived log is not evidence and is not hashed."""
        return ()

    def topics(self) -> pl.DataFrame:
        """Topics of the wrapped log."""
        return self._log.topics()

    def check(self) -> LogCheck:
        """Check the wrapped log."""
        return self._log.check()

    def notes(self) -> tuple[str, ...]:
        """Notes of the wrapped log."""
        return self._log.notes()

    def units(self, topic: str) -> Mapping[str, str]:
        """Units that the wrapped log states."""
        return self._log.units(topic)

    def losses(self) -> tuple[Loss, ...]:
        """Losses of the wrapped log."""
        return self._log.losses()


class CachedLog(DerivedLog):
    """A log whose decoded topics are cached in memory."""

    def __init__(self, log: Log) -> None:
        super().__init__(log)
        self._topics: pl.DataFrame | None = None
        self._kept: dict[tuple[str, tuple[str, ...], int | None, int | None], pl.DataFrame] = {}

    def topics(self) -> pl.DataFrame:
        """Topics of the log, listed once."""
        if self._topics is None:
            self._topics = super().topics()
        return self._topics

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """Read topics in one pass, except those in the cache."""
        wanted = {topic: (topic, tuple(names), start_ns, end_ns) for topic, names in fields.items()}
        new = {topic: fields[topic] for topic, key in wanted.items() if key not in self._kept}
        for topic, frame in self._log.read_many(new, start_ns, end_ns).items() if new else ():
            self._kept[wanted[topic]] = frame
        return {topic: self._kept[key] for topic, key in wanted.items()}

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the log."""
        return self._log.machine_ids()

    def announce_fields_to_read(self, fields: Mapping[str, Sequence[str]]) -> None:
        """Announce the fields that will be read, unless they are cached."""
        if not self._kept:
            self._log.announce_fields_to_read(fields)


class LogPart(DerivedLog):
    """Part of a log between two log times."""

    def __init__(self, log: Log, start_ns: int | None, end_ns: int | None) -> None:
        """Select a part of a log.

        Args:
            log: the open log.
            start_ns: first log time, inclusive; None for the start.
            end_ns: last log time, inclusive; None for the end.
        """
        super().__init__(log)
        self._span = start_ns, end_ns

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """Read the whole log, which may be cached, and select the part."""
        first, last = self._span
        bounds = [
            *(pl.col("log_time_ns") >= each for each in (first, start_ns) if each is not None),
            *(pl.col("log_time_ns") <= each for each in (last, end_ns) if each is not None),
        ]
        whole = self._log.read_many(fields)
        return {topic: frame.filter(*bounds) for topic, frame in whole.items()}


class _NamedTable(DerivedLog):
    """A table whose topic has its own name."""

    def __init__(self, log: Log, topic: str) -> None:
        """Rename the topic of an opened table."""
        super().__init__(log)
        self._topic = topic

    @property
    def files(self) -> tuple[Path, ...]:
        """File of the table."""
        return self._log.files

    @property
    def digests(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride] the table's
        """SHA-256 of every file, in hexadecimal."""
        return self._log.digests

    def topics(self) -> pl.DataFrame:
        """The single topic; see `Log.topics`."""
        return self._log.topics().with_columns(topic=pl.lit(self._topic))

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {t: self._log.read(TABLE, names, start_ns, end_ns) for t, names in fields.items()}

    def units(self, topic: str) -> Mapping[str, str]:  # noqa: ARG002 it has one
        """Units that the table states."""
        return self._log.units(TABLE)

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the table."""
        return self._log.machine_ids()


class NamedTopics(NamedTuple):
    """Logs with distinct topics, and the machine that reads them."""

    logs: Sequence[Log]
    machine: Machine


def assign_own_topics_to_parallel_tables(logs: Sequence[Log], machine: Machine) -> NamedTopics:
    """Give parallel tables a topic each, if the channels' columns are in only one of them each.

    Args:
        logs: logs of one time line.
        machine: machine with its channels.

    Returns:
        The logs, and the machine with the topic of each channel; unchanged if a log is not a table,
        or if two tables share a column of the channels.

    Raises:
        LogError: no table has a column.
    """
    wanted = {field for channel in machine.channels.values() for field in channel.fields}
    for log in logs:
        log.announce_fields_to_read({TABLE: sorted(wanted)})
    logs = _rename_topics_of_disjoint_tables(logs, wanted)
    columns = {
        topic: set[str](fields or [])
        for log in logs
        for topic, fields in log.topics().select("topic", "fields").iter_rows()
        if topic.startswith(_NAMED) or topic == TABLE
    }
    # one table alone needs no name
    if not any(topic.startswith(_NAMED) for topic in columns):
        return NamedTopics(logs, machine)
    by_field = {field: topic for topic, fields in columns.items() for field in fields & wanted}
    channels = dict(machine.channels)
    for name, channel in machine.channels.items():
        if channel.topic is not None or not channel.fields:
            continue
        (field, *_) = channel.fields
        if field not in by_field:
            paths = ", ".join(str(log.path) for log in logs)
            choices = suggest_choice(field, set().union(*columns.values()))
            raise LogError(f"{paths}: no column '{field}'; {choices}")
        channels[name] = channel.model_copy(update={"topic": by_field[field]})
    return NamedTopics(logs, machine.model_copy(update={"channels": channels}))


def _rename_topics_of_disjoint_tables(
    logs: Sequence[Log], wanted_columns: set[str]
) -> Sequence[Log]:
    """Give each table its own topic, unless two tables share wanted columns."""
    if len(logs) < 2 or len({log.digests for log in logs}) < len(logs):
        return logs
    topics = [log.topics() for log in logs]
    if any(table["topic"].to_list() != [TABLE] for table in topics):
        return logs
    held = [wanted_columns & set(table["fields"][0]) for table in topics]
    if not all(held) or any(one & other for one, other in combinations(held, 2)):
        return logs
    stems = [log.path.stem for log in logs]
    return [
        _NamedTable(log, _NAMED + (stem if stems.count(stem) == 1 else f"{stem} {number}"))
        for number, (log, stem) in enumerate(zip(logs, stems, strict=True), start=1)
    ]


class MemoryLog(Log):
    """Topics of a simulation as a log, with fields named like channels."""

    def __init__(self, simulated_log: "SimulatedLog") -> None:
        # a name for messages; there is no file
        super().__init__(Path(f"simulated_{simulated_log.load_kg:g}kg"), _FORMAT)
        self._frames = simulated_log.topics

    @property
    def files(self) -> tuple[Path, ...]:
        """No files: the log exists in memory only."""
        return ()

    def topics(self) -> pl.DataFrame:
        """Simulated topics; see `Log.topics`. Nothing is decoded."""
        rows = [
            {
                "topic": topic,
                "type": _FORMAT,
                "encoding": "columns",
                **self._make_topic_row_of_log_times(frame["log_time_ns"].to_numpy()),
                "fields": [name for name in frame.columns if name not in _STAMPS],
                "problem": None,
                "decoder": "columnar",
            }
            for topic, frame in self._frames.items()
        ]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {
            t: self._read_simulated_topic(t, names, start_ns, end_ns) for t, names in fields.items()
        }

    def _read_simulated_topic(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> pl.DataFrame:
        if topic not in self._frames:
            raise LogError(
                f"{self.path}: no topic '{topic}'; {suggest_choice(topic, self._frames)}"
            )
        frame = self._frames[topic]
        for field in fields:
            if field not in frame.columns:
                raise LogError(
                    f"{self.path}: no field '{field}'; {suggest_choice(field, frame.columns)}"
                )
        time = pl.col("log_time_ns")
        if start_ns is not None:
            frame = frame.filter(time >= start_ns)
        if end_ns is not None:
            frame = frame.filter(time <= end_ns)
        return frame.select(*_STAMPS, *fields).sort("log_time_ns", maintain_order=True)

    def check(self) -> LogCheck:
        """Report a clean check: data in memory needs none."""
        return LogCheck(sum(frame.height for frame in self._frames.values()), 0, 0)

    def losses(self) -> tuple[Loss, ...]:
        """No losses: nothing was read from a file."""
        return ()


def copy_machine_with_simulated_channels(
    machine: Machine, simulated_log: "SimulatedLog"
) -> Machine:
    """Copy the machine with its channels read from the topics of a simulation."""
    topic_of = {
        name: topic
        for topic, frame in simulated_log.topics.items()
        for name in frame.columns
        if name not in _STAMPS
    }
    channels = {
        name: channel if channel.derive else Channel(topic=topic_of[name], field=name)
        for name, channel in machine.channels.items()
    }
    return machine.model_copy(update={"channels": channels})
