"""Log of messages: read requested fields from a container, by the types of its topics."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.loss import Loss
from estimators.errors import LogError, suggest_choice
from replay.logs.decoding.decoder import DecodeTally, make_frame_schema
from replay.logs.decoding.decoder_choice import choose_decoder_name_of_type, make_decoder_of_fields
from replay.logs.log import Log, LogCheck
from replay.logs.log_limits import LIMITS
from replay.logs.machine_ids import read_distinct_serial_numbers
from replay.logs.message_definitions import DefinitionError, make_message_type_of_connection
from replay.logs.messages.message_fields import (
    OWN_COLUMNS,
    Field,
    FieldError,
    resolve_message_field,
)
from replay.logs.messages.message_types import (
    LeafField,
    MessageType,
    iter_leaf_fields_of_message_type,
    iter_leaf_paths_of_message_type,
)
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage import Connection, Container, LossList, make_empty_log_times

if TYPE_CHECKING:
    from replay.logs.decoding.batch_stream import TopicStream


@dataclass(frozen=True, slots=True)
class _Topic:
    connections: tuple[Connection, ...]
    #: None if there is a problem
    kind: MessageType | None
    problem: str | None


class MessageLog(Log):
    """A log whose topics hold messages: ROS 1 bag, MCAP, rosbag2."""

    def __init__(
        self, path: Path, log_format: str, open_container: Callable[[Path], Container]
    ) -> None:
        self._container = open_container(path)
        super().__init__(path, log_format, self._container.close)
        self._read_losses = LossList()

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file of the log."""
        return self._container.files

    def topics(self) -> pl.DataFrame:
        """Topics of the log; see `Log.topics`."""
        return self._topic_summaries

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers in MCAP's metadata records, or in `custom_data`."""
        return read_distinct_serial_numbers(self.files)

    @cached_property
    def _topics(self) -> dict[str, _Topic]:
        self._refuse_closed_log()
        by_name: dict[str, list[Connection]] = {}
        for connection in self._container.connections:
            by_name.setdefault(connection.topic, []).append(connection)
        return {
            name: _merge_connections_into_topic(tuple(by_name[name])) for name in sorted(by_name)
        }

    @cached_property
    def _topic_summaries(self) -> pl.DataFrame:
        rows = [
            {"topic": name, **self._make_topic_row(topic)} for name, topic in self._topics.items()
        ]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def _make_topic_row(self, topic: _Topic) -> dict[str, object]:
        log_times = [self._container.log_times(c.id) for c in topic.connections]
        return {
            "type": ", ".join(dict.fromkeys(c.type for c in topic.connections)),
            "encoding": ", ".join(dict.fromkeys(c.encoding for c in topic.connections)),
            **self._make_topic_row_of_log_times(np.concatenate(log_times)),
            "fields": list(iter_leaf_paths_of_message_type(topic.kind.record))
            if topic.kind
            else [],
            "problem": topic.problem,
            "decoder": choose_decoder_name_of_type(topic.kind) if topic.kind else None,
        }

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        readings = {
            topic: self._make_stream_of_topic(topic, names) for topic, names in fields.items()
        }
        streams = {
            c.id: reading for t, reading in readings.items() for c in self._topics[t].connections
        }
        groups = self._container.iter_batch_groups(list(streams), start_ns, end_ns)
        self._feed_all_batches_to_streams((group.batches for group in groups), streams)
        return {
            topic: self._drain_stream_and_note_losses(topic, reading)
            for topic, reading in readings.items()
        }

    def _iter_frames_of_topic(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> Iterator[pl.DataFrame]:
        from replay.logs.decoding.batch_stream import iter_decoded_rows_of_streams

        stream = self._make_stream_of_topic(topic, fields)
        streams = {connection.id: stream for connection in self._topics[topic].connections}
        groups = self._container.iter_batch_groups(list(streams), start_ns, end_ns)
        try:
            for _, rows in iter_decoded_rows_of_streams(groups, streams):
                yield rows
        except GeneratorExit:  # the consumer needs no more
            self._note_undecoded_messages(topic, stream.tally)
            raise
        self._note_decoding_failures(topic, stream.tally)

    def _iter_frames_of_topics(
        self,
        fields: Mapping[str, Sequence[str]],
        faults: dict[str, str],
        start_ns: int | None,
        end_ns: int | None,
    ) -> Iterator[tuple[str, pl.DataFrame]]:
        from replay.logs.decoding.batch_stream import iter_decoded_rows_of_streams

        readings = {
            topic: self._make_stream_of_topic(topic, names) for topic, names in fields.items()
        }
        topics = {stream: topic for topic, stream in readings.items()}
        streams = {c.id: s for t, s in readings.items() for c in self._topics[t].connections}
        groups = self._container.iter_batch_groups(list(streams), start_ns, end_ns)
        for stream, rows in iter_decoded_rows_of_streams(groups, streams):
            yield topics[stream], rows
        for topic, stream in readings.items():
            fault = self._explain_why_topic_is_unreadable(topic, stream.tally)
            if fault:
                faults[topic] = fault
            else:
                self._note_undecoded_messages(topic, stream.tally)

    def topic_names(self) -> list[str]:
        """The topics; see `Log.topic_names`."""
        return list(self._topics)

    def definition(self, topic: str) -> str:
        """The definition of the topic's messages; see `Log.definition`."""
        return self._topics[topic].connections[0].definition

    def leaf_fields(self, topic: str, fields: Sequence[str] | None = None) -> tuple[LeafField, ...]:
        """Describe the columns of fields; see `Log.leaf_fields`."""
        self._refuse_closed_log()
        kind = self._require_decodable_topic(topic).kind
        assert kind is not None, "it is usable"
        leaves = {leaf.name: leaf for leaf in iter_leaf_fields_of_message_type(kind.record)}
        if fields is None:
            return tuple(leaf for name, leaf in leaves.items() if name not in OWN_COLUMNS)
        resolved = self._resolve_fields(topic, fields, kind)
        return tuple(leaves.get(f.name, LeafField(f.name, f.column_dtype)) for f in resolved)

    def _require_decodable_topic(self, topic: str) -> _Topic:
        """Return the topic; raise an error if it does not exist or cannot be decoded."""
        found = self._topics.get(topic)
        if found is None:
            raise LogError(
                f"{self.path}: no topic '{topic}'; {suggest_choice(topic, self._topics)}"
            )
        if found.kind is None:
            raise LogError(f"{self.path}: topic '{topic}' cannot be read: {found.problem}")
        return found

    def _make_stream_of_topic(self, topic: str, fields: Sequence[str]) -> "TopicStream":
        from replay.logs.decoding.batch_stream import TopicStream

        kind = self._require_decodable_topic(topic).kind
        assert kind is not None, "it is usable"
        picked = self._resolve_fields(topic, fields, kind)
        return TopicStream(make_decoder_of_fields(kind, picked), make_frame_schema(picked))

    def _feed_all_batches_to_streams(
        self, groups: Iterable[list[RawBatch]], streams: Mapping[int, "TopicStream"]
    ) -> None:
        # numba is slow to import, and a log can be described without it
        from replay.logs.decoding.batch_stream import feed_batches_to_streams

        feed_batches_to_streams(groups, streams)

    def _drain_stream_and_note_losses(self, topic: str, stream: "TopicStream") -> pl.DataFrame:
        frame = stream.drain_all_rows()
        self._note_decoding_failures(topic, stream.tally)
        return frame

    def _resolve_fields(
        self, topic: str, fields: Sequence[str], message_type: MessageType
    ) -> list[Field]:
        """Find the requested fields in the message type."""
        try:
            return [
                resolve_message_field(name, message_type.record) for name in dict.fromkeys(fields)
            ]
        except FieldError as error:
            raise LogError(
                f"{self.path}: topic '{topic}' ({message_type.record.name}): {error}"
            ) from error

    def _note_decoding_failures(self, topic: str, tally: DecodeTally) -> None:
        """Raise an error if no message was decoded, else note undecoded messages as losses."""
        fault = self._explain_why_topic_is_unreadable(topic, tally)
        if fault:
            raise LogError(f"{self.path}: topic '{topic}' cannot be read: {fault}")
        self._note_undecoded_messages(topic, tally)

    def _explain_why_topic_is_unreadable(self, topic: str, tally: DecodeTally) -> str:
        """Reason why no message of a topic can be read; empty if at least one was."""
        kind = self._topics[topic].kind
        assert kind is not None, "it was read"
        if tally.rows or not tally.undecodable:
            return ""
        return (
            f"none of its {tally.undecodable:,} messages fits the definition of "
            f"{kind.record.name}: {tally.first_fault}"
        )

    def _note_undecoded_messages(self, topic: str, tally: DecodeTally) -> None:
        if tally.undecodable:
            total = tally.rows + tally.undecodable
            self._read_losses.add_loss(
                self.path,
                f"{tally.undecodable:,} of {total:,} messages cannot be decoded: "
                f"{tally.first_fault}",
                topic,
            )
        if tally.back_ns > LIMITS.clock_jump_ns:
            self._read_losses.add_loss(
                self.path,
                f"log times jump back, by up to {tally.back_ns / 1e9:.3f} s: messages were sorted "
                "by log time, so that two recordings in one file may be mixed",
                topic,
            )

    def check(self) -> LogCheck:
        """Read and decode everything; see `Log.check`."""
        self._refuse_closed_log()
        # without a field to gather, a message is still walked to its end
        streams = {
            t: self._make_stream_of_topic(t, ()) for t, topic in self._topics.items() if topic.kind
        }
        topics = {c.id: c.topic for c in self._container.connections}
        times = {key: [make_empty_log_times()] for key in topics}
        message_bytes = 0

        def count_messages() -> Iterator[list[RawBatch]]:
            nonlocal message_bytes
            for group, _ in self._container.iter_batch_groups(list(topics), None, None):
                for batch in group:
                    times[batch.connection_id].append(batch.log_times)
                    message_bytes += int(batch.lengths.sum())
                yield [batch for batch in group if topics[batch.connection_id] in streams]

        group_by_key = {key: streams[t] for key, t in topics.items() if t in streams}
        self._feed_all_batches_to_streams(count_messages(), group_by_key)
        for topic, stream in streams.items():
            stream.drain_all_rows()
            self._note_undecoded_messages(topic, stream.tally)
        crcs = self._container.check_whole_file_and_count_valid_crcs()
        found = {key: np.concatenate(parts) for key, parts in times.items()}
        if not self._container.losses:  # losses would explain any difference
            self._note_times_that_differ_from_index(found)
        return LogCheck(sum(each.size for each in found.values()), message_bytes, crcs)

    def _note_times_that_differ_from_index(
        self, times_by_connection: Mapping[int, NDArray[np.int64]]
    ) -> None:
        """Note as a loss each connection whose log times, (n,) in ns, differ from the index."""
        for connection in self._container.connections:
            there, said = (
                times_by_connection[connection.id],
                self._container.log_times(connection.id),
            )
            if not np.array_equal(np.sort(there), np.sort(said)):
                self._read_losses.add_loss(
                    self.path,
                    f"the index lists {said.size:,} messages and {there.size:,} were found; "
                    "their number or their log times differ",
                    connection.topic,
                )

    def losses(self) -> tuple[Loss, ...]:
        """Losses so far: data that could not be read."""
        # before the container's losses are read: counting messages may add some
        counts = {
            name: sum(self._container.message_count(c.id) for c in topic.connections)
            for name, topic in self._topics.items()
        }
        undecodable = [
            Loss(source=self.path.name, topic=name, what=topic.problem)
            for name, topic in self._topics.items()
            if topic.problem and counts[name]
        ]
        return (*self._container.losses, *undecodable, *self._read_losses)


def _merge_connections_into_topic(connections: tuple[Connection, ...]) -> _Topic:
    """Merge the connections of a topic; if their types differ, the topic has a problem."""
    try:
        distinct = dict.fromkeys(replace(connection, id=0) for connection in connections)
        kinds = [make_message_type_of_connection(connection) for connection in distinct]
    except DefinitionError as error:
        return _Topic(connections, None, str(error))
    encodings = {connection.encoding for connection in connections}
    if len({kind.record for kind in kinds}) > 1 or len(encodings) > 1:
        types = ", ".join(dict.fromkeys(f"{c.type} ({c.encoding})" for c in connections))
        return _Topic(
            connections, None, f"{len(connections)} connections whose definitions differ: {types}"
        )
    return _Topic(connections, kinds[0], None)
