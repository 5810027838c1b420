"""Messages as containers hand them over, and as the official readers do."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from mcap.reader import NonSeekingReader
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from replay.logs.storage.container import Container

#: topic, log time in ns, bytes
Stored = tuple[str, int, bytes]


def stored(container: Container, start_ns: int | None = None, end_ns: int | None = None) -> list:
    """Every message, in the order of topic, then of the file."""
    topics = {connection.id: connection.topic for connection in container.connections}
    found: list[Stored] = []
    for batch in chain.from_iterable(
        g.batches for g in container.iter_batch_groups(list(topics), start_ns, end_ns)
    ):
        logged = batch.log_times.tolist()
        topic = topics[batch.connection_id]
        found += [(topic, t, data) for t, data in zip(logged, batch.iter_messages(), strict=True)]
    return sorted(found, key=lambda message: message[0])


def times(messages: list) -> list[int]:
    """When they were logged, ascending."""
    return sorted(time for _, time, _ in messages)


def official_mcap(path: Path) -> list[Stored]:
    with path.open("rb") as file:
        messages = NonSeekingReader(file).iter_messages(log_time_order=False)
        return _sorted((c.topic, m.log_time, m.data) for _, c, m in messages)


def official_bag(path: Path) -> list[Stored]:
    with Reader1(path) as reader:
        return _sorted((c.topic, time, bytes(data)) for c, time, data in reader.messages())


def official_rosbag2(path: Path) -> list[Stored]:
    with Reader2(path) as reader:
        return _sorted((c.topic, time, bytes(data)) for c, time, data in reader.messages())


def _sorted(messages: Iterator[Stored]) -> list[Stored]:
    return sorted(messages, key=lambda message: message[0])
