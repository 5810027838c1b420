"""The container of an MCAP file: by its index where that is whole, else from start to end."""

from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Schema
from rosbags.typesys.msg import normalize_msgtype

from estimators.errors import LogError
from replay.logs.blocks import Block, BlockFile, Grammar, torn_end, until
from replay.logs.mcap.mcap_index import Summary, damaged_block, indexed_times
from replay.logs.mcap.mcap_records import CHANNEL, MAGIC, RECORD_HEAD, chunk_block
from replay.logs.mcap.mcap_walk import McapWalk
from replay.logs.messages.broken_bytes import BROKEN_BYTES
from replay.logs.storage import Connection


class McapFile(BlockFile):
    """An MCAP file.

    The index is used only if it accounts for every message: chunks without a message index,
    messages outside chunks, channels that the summary does not repeat, or a missing footer are
    all found in files of the field. What it does not account for is surveyed at opening.
    """

    def _open(self) -> tuple[Connection, ...]:
        if self._file.read(0, len(MAGIC)) != MAGIC:
            raise LogError(
                f"{self._file.path}: not an MCAP file; it does not start with the MCAP magic"
            )
        summary = Summary(self._file)
        self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
        self._channels_at = dict.fromkeys(self._channels, -1)
        self._schemas_at = dict.fromkeys(self._schemas, -1)
        self._is_sealed = summary.is_sealed
        self._take_index(summary)
        said = summary.message_count
        indexed, lost = self._store.message_count, self._store.damage.lost_messages
        is_enough = indexed > 0 if said is None else lost is None or indexed + lost == said
        walk = None
        if not is_enough:
            self._store = self._new_store()
            walk = self._walk()
            said = walk.message_count if said is None else said
        found = self._store.message_count
        # where every damaged chunk tells how many messages it held, that is said with it
        told = self._store.damage.lost_messages or 0
        if said not in (None, found + told):
            self._store.damage.note(f"its statistics count {said:,} messages, {found:,} are there")
        if walk is not None:
            self._judge_end(walk, summary.fault)
        return tuple(
            make_connection(channel, self._schemas.get(channel.schema_id))
            for channel in self._channels.values()
        )

    @staticmethod
    def _grammar() -> Grammar:
        from replay.logs.mcap.mcap_grammar import GRAMMAR

        return GRAMMAR

    def check(self) -> int:
        """Go through the file from start to end, and compare the CRCs of its data and summary."""
        walk = McapWalk(self._second_store(), self._describe)
        self._compare(walk.chunks(), walk.store)
        if not (walk.data_end and walk.has_footer) and not self._store.damage:
            self._store.damage.note("its records do not lead from its data to its footer")
        return self._store.crcs + self._is_sealed + self._is_data_sealed(walk.data_end)

    def _is_data_sealed(self, end: int) -> bool:
        """Whether the data that end before `end` have a CRC, which agrees."""
        said = int.from_bytes(self._file.read(end + RECORD_HEAD.size, 4), "little") if end else 0
        if not said:  # 0 says that the writer computed none
            return False
        agrees = self._file.crc32(end) == said
        if not agrees:
            self._store.damage.note(
                f"the CRC of its data is wrong: some of their {end:,} bytes are not as they were "
                "recorded, and nothing tells which"
            )
        return agrees

    def _take_index(self, summary: Summary) -> None:
        described = all(c.schema_id in {0, *summary.schemas} for c in summary.channels.values())
        unknown: list[Block] = []
        chunks = {chunk.chunk_start_offset: chunk for chunk in summary.chunks}
        for offset in sorted(chunks):
            block = chunk_block(self._file, offset)
            times = indexed_times(self._file, chunks[offset])
            # the index stands behind all chunks, so that the end of the file tears none of them
            if block is None or block.is_torn:
                lost = damaged_block(chunks[offset])
                self._store.lose(lost, times or {}, "it is not where the index says")
            elif times is None or not described or not self._channels.keys() >= times.keys():
                unknown.append(block)
            else:
                self._store.add(block, times)
        if unknown:
            self._store.survey(unknown)

    def _walk(self) -> McapWalk:
        """Go through the file, from start to end."""
        walk = McapWalk(self._store, self._describe)
        self._store.survey(walk.chunks())
        if not self._store.damage:
            # messages outside chunks have no CRC but that of all data together
            self._is_data_sealed(walk.data_end)
        return walk

    def _judge_end(self, walk: McapWalk, fault: str) -> None:
        """Say what is missing behind its data; `fault` is why its index is of no use."""
        if walk.has_footer or walk.data_ended:  # behind the data there is only an index
            if fault:
                self._store.damage.note(
                    f"{fault}: torn or damaged after the data, which is complete and was scanned "
                    "from start to end"
                )
            return
        size = self._file.size
        torn = torn_end(size - walk.whole, self._store.torn_messages)
        self._store.damage.note(
            f"breaks off after byte {walk.whole} of {size}, without a footer: all whole messages "
            f"are read{until(self._store.last_ns)}{torn}"
        )

    def _describe(self, op: int, content: bytes, at: int) -> None:
        """Keep a channel or a schema, the first of each number; the summary's counts as first."""
        stream = ReadDataStream(BytesIO(content))
        try:
            record = Channel.read(stream) if op == CHANNEL else Schema.read(stream)
        except (McapError, *BROKEN_BYTES) as error:
            kind = "channel" if op == CHANNEL else "schema"
            self._store.damage.note(f"the record of a {kind} is damaged: {error}")
            return
        if isinstance(record, Channel):
            if at < self._channels_at.get(record.id, self._file.size):
                self._channels[record.id], self._channels_at[record.id] = record, at
        elif at < self._schemas_at.get(record.id, self._file.size):
            self._schemas[record.id], self._schemas_at[record.id] = record, at


def make_connection(channel: Channel, schema: Schema | None) -> Connection:
    """A channel and its schema as a connection."""
    if schema is None:
        return Connection(channel.id, channel.topic, "", channel.message_encoding, "", "")
    name = schema.name
    # bytes that are no text come back by the same error handler
    errors = "surrogateescape" if schema.encoding == "protobuf" else "replace"
    return Connection(
        channel.id,
        channel.topic,
        # ROS 1 leaves out the /msg/ that ROS 2 has; a service's event has /srv/ in its place
        normalize_msgtype(name) if schema.encoding == "ros1msg" else name,
        channel.message_encoding,
        schema.data.decode(errors=errors),
        schema.encoding,
    )
