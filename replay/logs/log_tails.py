"""Read new rows of a table, or fields of new messages, while the log is being recorded."""

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError
from replay.logs.decoding.decoder import Decoder, run_work_immediately
from replay.logs.decoding.decoder_choice import make_decoder_of_fields
from replay.logs.log import TABLE, TimeAxis
from replay.logs.log_limits import LIMITS
from replay.logs.message_definitions import DefinitionError, make_message_type_of_connection
from replay.logs.messages.message_fields import FieldError, resolve_message_field
from replay.logs.storage import Connection, FileBytes, LossList, Tail
from replay.logs.table_log import TableLog


class TableTail:
    """A growing text table, from which the end of the recording cannot be known."""

    def __init__(
        self, path: Path, time_axis: TimeAxis | None, fields: Mapping[str, Sequence[str]]
    ) -> None:
        """Begin before the first line.

        Args:
            path: path of the table.
            time_axis: time column and format; None to detect them.
            fields: fields by topic; a table has one topic.
        """
        self.is_finished = False
        self.topics = [TABLE]
        self._path, self._time, self._fields = path, time_axis, list(fields.get(TABLE, ()))
        self._file = FileBytes(path)
        self._scratch = TemporaryDirectory(prefix="payscope-")
        self._losses = LossList()
        self._at = 0
        #: lines above the first row; None until they are recognised
        self._head: bytes | None = None
        self._waiting: list[bytes] = []
        self._before: deque[bytes] = deque(maxlen=LIMITS.rows_before)
        self._last_ns: int | None = None

    @property
    def losses(self) -> Sequence[Loss]:
        """Losses so far: data that could not be read."""
        return [*self._losses]

    def poll(self, *, is_log_complete: bool = False) -> dict[str, pl.DataFrame]:
        """Rows completed since the last poll; `is_log_complete` includes one without a newline."""
        new = self._file.update_size() - self._at
        data = self._file.read_bytes(self._at, min(new, LIMITS.poll_bytes))
        end = len(data) if is_log_complete and len(data) == new else data.rfind(b"\n") + 1
        self._at += end
        self._waiting += data[:end].splitlines(keepends=True)
        if not self._waiting:
            return {}
        if self._head is None and len(self._waiting) < LIMITS.head_rows and not is_log_complete:
            return {}
        frame = self._parse_table_text(b"".join([self._head or b"", *self._before, *self._waiting]))
        if self._head is None:
            above = max(0, len(self._waiting) - frame.height)
            self._head = b"".join(self._waiting[:above])
            self._waiting = self._waiting[above:]
        self._before.extend(self._waiting)
        self._waiting = []
        if self._last_ns is not None:
            frame = frame.filter(pl.col("log_time_ns") > self._last_ns)
        if frame.is_empty():
            return {}
        self._last_ns = int(frame["log_time_ns"].to_numpy().max())
        return {TABLE: frame}

    def close(self) -> None:
        """Release the file."""
        self._file.close()
        self._scratch.cleanup()

    def _parse_table_text(self, text: bytes) -> pl.DataFrame:
        part = Path(self._scratch.name) / self._path.name
        part.write_bytes(text)
        try:
            with TableLog(part, self._time) as table:
                frame = table.read(TABLE, self._fields)
                for loss in table.losses():
                    self._losses.add_loss(self._path, loss.what)
        except LogError as error:
            raise LogError(str(error).replace(str(part), str(self._path))) from error
        return frame


class MessageTail:
    """Reader of the requested fields of a growing log of messages."""

    def __init__(self, path: Path, tail: Tail, fields: Mapping[str, Sequence[str]]) -> None:
        """Begin before the first message.

        Args:
            path: path for error messages.
            tail: the growing log.
            fields: fields by topic; each is checked when its first message arrives.
        """
        self._path, self._tail, self._fields = path, tail, fields
        self._decoders: dict[int, Decoder | None] = {}
        self._losses = LossList()

    @property
    def is_finished(self) -> bool:
        """Whether the recorder has closed the log and all rows were returned."""
        return self._tail.is_finished

    @property
    def topics(self) -> list[str]:
        """Topics found so far."""
        return sorted({connection.topic for connection in self._tail.connections.values()})

    @property
    def losses(self) -> Sequence[Loss]:
        """Losses so far: data that could not be read."""
        return [*self._tail.losses, *self._losses]

    def poll(self, *, is_log_complete: bool = False) -> dict[str, pl.DataFrame]:
        """New complete rows of each topic, in the order of the file.

        Raises:
            LogError: a requested topic cannot be decoded, or lacks a field.
        """
        found: dict[str, list[pl.DataFrame]] = {}
        for batch in self._tail.poll():
            connection = self._tail.connections.get(batch.connection_id)
            decoder = self._get_decoder_of_connection(connection) if connection else None
            if connection is None or decoder is None:
                continue
            decoded = decoder.begin_decoding(batch, run_work_immediately)()
            if decoded.undecodable:
                what = f"messages cannot be decoded: {decoded.first_fault}"
                self._losses.add_loss(self._path, what, connection.topic)
            found.setdefault(connection.topic, []).append(decoded.frame)
        if is_log_complete:
            self._tail.finish_and_note_incomplete_end()
        return {topic: pl.concat(frames) for topic, frames in found.items()}

    def close(self) -> None:
        """Release the file."""
        self._tail.close()

    def _get_decoder_of_connection(self, connection: Connection) -> Decoder | None:
        """Decoder of a connection; None if none of its fields is requested."""
        if connection.topic not in self._fields:
            return None
        if connection.id not in self._decoders:
            about = f"{self._path}: topic '{connection.topic}'"
            try:
                kind = make_message_type_of_connection(connection)
                names = dict.fromkeys(self._fields[connection.topic])
                picked = [resolve_message_field(name, kind.record) for name in names]
            except DefinitionError as error:
                raise LogError(f"{about} cannot be read: {error}") from error
            except FieldError as error:
                raise LogError(f"{about} ({connection.type}): {error}") from error
            self._decoders[connection.id] = make_decoder_of_fields(kind, picked)
        return self._decoders[connection.id]
