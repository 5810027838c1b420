"""The fields of a growing log of messages, decoded as they become whole."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError
from replay.logs.decoding.decoder import Decoder, at_once
from replay.logs.decoding.decoder_choice import make_decoder
from replay.logs.message_definitions import DefinitionError, compile_type
from replay.logs.messages.message_fields import FieldError, resolve
from replay.logs.storage import Connection, LossList, Tail


class MessageTail:
    """The fields that are asked for of a tail."""

    def __init__(self, path: Path, tail: Tail, fields: Mapping[str, Sequence[str]]) -> None:
        """Begin before the first message.

        Args:
            path: what errors name.
            tail: of the log.
            fields: by topic; each is checked when its first message comes.
        """
        self._path, self._tail, self._fields = path, tail, fields
        self._decoders: dict[int, Decoder | None] = {}
        self._losses = LossList()

    @property
    def is_finished(self) -> bool:
        """Whether the recorder has closed the log, and all of it was given."""
        return self._tail.is_finished

    @property
    def topics(self) -> list[str]:
        """The topics that it has so far."""
        return sorted({connection.topic for connection in self._tail.connections.values()})

    @property
    def losses(self) -> Sequence[Loss]:
        """What could not be read so far."""
        return [*self._tail.losses, *self._losses]

    def poll(self, *, is_whole: bool = False) -> dict[str, pl.DataFrame]:
        """The rows of each topic that became whole since, in the order of the file.

        Raises:
            LogError: a topic that is asked for cannot be decoded, or has no such field.
        """
        found: dict[str, list[pl.DataFrame]] = {}
        for batch in self._tail.poll():
            connection = self._tail.connections.get(batch.connection_id)
            decoder = self._decoder(connection) if connection else None
            if connection is None or decoder is None:
                continue
            decoded = decoder.begin(batch, at_once)()
            if decoded.undecodable:
                what = f"messages cannot be decoded: {decoded.first_fault}"
                self._losses.note(self._path, what, connection.topic)
            found.setdefault(connection.topic, []).append(decoded.frame)
        if is_whole:
            self._tail.end()
        return {topic: pl.concat(frames) for topic, frames in found.items()}

    def close(self) -> None:
        """Release the file."""
        self._tail.close()

    def _decoder(self, connection: Connection) -> Decoder | None:
        """The decoder of a connection; None where nothing of it is asked for."""
        if connection.topic not in self._fields:
            return None
        if connection.id not in self._decoders:
            about = f"{self._path}: topic '{connection.topic}'"
            try:
                kind = compile_type(connection)
                names = dict.fromkeys(self._fields[connection.topic])
                picked = [resolve(name, kind.record) for name in names]
            except DefinitionError as error:
                raise LogError(f"{about} cannot be read: {error}") from error
            except FieldError as error:
                raise LogError(f"{about} ({connection.type}): {error}") from error
            self._decoders[connection.id] = make_decoder(kind, picked)
        return self._decoders[connection.id]
