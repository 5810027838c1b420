"""A simulated log in memory, replayed without a file."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from analysis.model.loss import Loss
from analysis.model.machine import Channel, Machine
from analysis.simulation import SimulatedLog
from estimators.errors import LogError, nearest
from replay.logs import Log, LogCheck

_STAMPS = ("log_time_ns", "header_stamp_ns")
_FORMAT = "simulation in memory"


class MemoryLog(Log):
    """Topics of a simulation as a log, with fields named like channels."""

    def __init__(self, simulated: SimulatedLog) -> None:
        # a name for messages; there is no file
        super().__init__(Path(f"simulated_{simulated.load_kg:g}kg"), _FORMAT)
        self._frames = simulated.topics

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
                **self._summarise_log_times(frame["log_time_ns"].to_numpy()),
                "fields": [name for name in frame.columns if name not in _STAMPS],
                "problem": None,
                "decoder": "columnar",
            }
            for topic, frame in self._frames.items()
        ]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {t: self._read(t, names, start_ns, end_ns) for t, names in fields.items()}

    def _read(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> pl.DataFrame:
        if topic not in self._frames:
            raise LogError(f"{self.path}: no topic '{topic}'; {nearest(topic, self._frames)}")
        frame = self._frames[topic]
        for field in fields:
            if field not in frame.columns:
                raise LogError(f"{self.path}: no field '{field}'; {nearest(field, frame.columns)}")
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


def machine_with_memory_channels(machine: Machine, simulated: SimulatedLog) -> Machine:
    """The machine with its channels read from the topics of a simulation."""
    topic_of = {
        name: topic
        for topic, frame in simulated.topics.items()
        for name in frame.columns
        if name not in _STAMPS
    }
    channels = {
        name: channel if channel.derive else Channel(topic=topic_of[name], field=name)
        for name, channel in machine.channels.items()
    }
    return machine.model_copy(update={"channels": channels})
