"""Read a recording as a log: the channels that its replay read."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError, suggest_choice
from recordings.rrd.reader import open_recording
from recordings.rrd.stored_frames import StoredFrame
from replay.logs.log import Log, LogCheck

_STAMPS: Final = ("log_time_ns", "header_stamp_ns")
_RAW: Final = "raw/"
_FORMAT: Final = "recording"


class RecordingLog(Log):
    """The channels that `run` wrote under `raw`; other fields of the log are absent."""

    def __init__(self, path: Path) -> None:
        """Read the description of the recording.

        Args:
            path: the `.rrd` file.

        Raises:
            RecordingError: not a recording of payscope.
            LogError: the recording contains no channels.
        """
        super().__init__(path, _FORMAT)
        with open_recording(path) as held:
            about, stages = held.provenance, held.columns_by_frame
        self._losses = about.losses
        self._machine_id = about.logged_machine_id
        self._missing: dict[str, Loss] = {}
        channels: Mapping[str, Any] = about.machine.get("channels", {})
        named = {channel.get("topic") for channel in channels.values()}
        self._stage = {
            _make_topic_name_of_stage(stage.removeprefix(_RAW), named): stage
            for stage in stages
            if stage.startswith(_RAW)
        }
        self._fields = {
            topic: [name for name in stages[stage] if name not in _STAMPS]
            for topic, stage in self._stage.items()
        }
        if not self._stage:
            raise LogError(
                f"{path}: does not contain the channels of its log; replay the log itself (a "
                "review keeps them with --full)"
            )

    @property
    def files(self) -> tuple[Path, ...]:
        """The file of the recording."""
        return (self.path,)

    def topics(self) -> pl.DataFrame:
        """Topics that the replay read; see `Log.topics`."""
        with open_recording(self.path) as held:
            times = {t: held.read_frame(s, _STAMPS[:1]) for t, s in self._stage.items()}
        rows = [
            {
                "topic": topic,
                "type": _FORMAT,
                "encoding": "columns",
                **self._make_topic_row_of_log_times(times[topic]["log_time_ns"].to_numpy()),
                "fields": fields,
                "problem": None,
                "decoder": "columnar",
            }
            for topic, fields in self._fields.items()
        ]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        found: dict[str, pl.DataFrame] = {}
        for topic, names in fields.items():
            if topic not in self._stage:
                raise LogError(
                    f"{self.path}: no topic '{topic}'; {suggest_choice(topic, self._stage)}"
                )
            has = self._fields[topic]
            for name in names:
                if name not in has:
                    raise LogError(
                        f"{self.path}: topic '{topic}' was recorded without field '{name}'; "
                        f"{suggest_choice(name, has)}, or replay the log itself"
                    )
        with open_recording(self.path) as held:
            for topic, names in fields.items():
                frame = held.read_frame(self._stage[topic], [*_STAMPS, *names])
                self._note_rows_missing_from_recording(
                    topic, held.manifest.find_frame_by_name(self._stage[topic]), frame.height
                )
                time = pl.col("log_time_ns")
                if start_ns is not None:
                    frame = frame.filter(time >= start_ns)
                if end_ns is not None:
                    frame = frame.filter(time <= end_ns)
                found[topic] = frame
        return found

    def check(self) -> LogCheck:
        """Read every channel."""
        read = self.read_many(self._fields)
        return LogCheck(sum(frame.height for frame in read.values()), 0, 0)

    def machine_ids(self) -> tuple[str, ...]:
        """Serial number of the recorded machine; empty if unknown."""
        return (self._machine_id,) if self._machine_id else ()

    def losses(self) -> tuple[Loss, ...]:
        """Losses of the recorded log, and rows missing from a recovered recording."""
        return (*self._losses, *self._missing.values())

    def _note_rows_missing_from_recording(
        self, topic: str, stored_frame: StoredFrame | None, read_row_count: int
    ) -> None:
        if stored_frame is not None and read_row_count != stored_frame.rows:
            what = f"the recording has {read_row_count} of {stored_frame.rows} rows"
            self._missing[topic] = Loss(source=self.path.name, topic=topic, what=what)


def _make_topic_name_of_stage(stage: str, topic_names: set[str | None]) -> str:
    """Name of the topic of a stage: the stage's name, with a leading slash if the topic has one."""
    return f"/{stage}" if f"/{stage}" in topic_names else stage
