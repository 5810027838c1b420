"""Tables over the same time with different columns, as one log with a topic per table."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Final

import polars as pl

from analysis.model.loss import Loss
from analysis.model.machine import Machine
from estimators.errors import LogError, nearest
from replay.logs import TABLE, Log, LogCheck

#: Begins the topic of a table that is one of several side by side.
_NAMED: Final = f"{TABLE}/"


class _NamedTable(Log):
    """A table whose topic has its own name."""

    def __init__(self, log: Log, topic: str) -> None:
        """Rename the topic of an opened table."""
        super().__init__(log.path, log.format)
        self._log, self._topic = log, topic

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

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {t: self._log.read(TABLE, names, start_ns, end_ns) for t, names in fields.items()}

    def notes(self) -> tuple[str, ...]:
        """Notes on what was recognised in the table."""
        return self._log.notes()

    def units(self, topic: str) -> Mapping[str, str]:  # noqa: ARG002 it has one
        """Units that the table states."""
        return self._log.units(TABLE)

    def losses(self) -> tuple[Loss, ...]:
        """Losses: data that could not be read."""
        return self._log.losses()

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the table."""
        return self._log.machine_ids()

    def check(self) -> LogCheck:
        """Check the table."""
        return self._log.check()


def join_parallel_tables(logs: Sequence[Log], machine: Machine) -> tuple[Sequence[Log], Machine]:
    """Give tables that share no column of the channels topics of their own.

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
        log.expect({TABLE: sorted(wanted)})
    logs = _tables_with_own_topics(logs, wanted)
    columns = {
        topic: set[str](fields or [])
        for log in logs
        for topic, fields in log.topics().select("topic", "fields").iter_rows()
        if topic.startswith(_NAMED) or topic == TABLE
    }
    # one table alone needs no name
    if not any(topic.startswith(_NAMED) for topic in columns):
        return logs, machine
    by_field = {field: topic for topic, fields in columns.items() for field in fields & wanted}
    channels = dict(machine.channels)
    for name, channel in machine.channels.items():
        if channel.topic is not None or not channel.fields:
            continue
        (field, *_) = channel.fields
        if field not in by_field:
            paths = ", ".join(str(log.path) for log in logs)
            choices = nearest(field, set().union(*columns.values()))
            raise LogError(f"{paths}: no column '{field}'; {choices}")
        channels[name] = channel.model_copy(update={"topic": by_field[field]})
    return logs, machine.model_copy(update={"channels": channels})


def _tables_with_own_topics(logs: Sequence[Log], wanted_columns: set[str]) -> Sequence[Log]:
    """Tables with topics of their own, unless two share wanted columns."""
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
