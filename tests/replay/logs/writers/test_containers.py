"""Files of logs are those that the libraries' own writers make of the same messages."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from replay.logs import open_log
from replay.logs.writers.bag_writer import write_bag
from replay.logs.writers.mcap_writer import write_mcap
from replay.logs.writers.recorded_order import BLOCK_ROWS, RecordBlock, split_into_chunks
from replay.logs.writers.ros_messages import TOPICS, make_message_columns
from replay.logs.writers.rosbag2_writer import write_db3, write_rosbag2


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    """More messages than a block, of several chunks, swapped and lost here and there."""
    scenario = Scenario.model_validate(
        {
            "campaign": {"loads_kg": [0], "runs": 6},
            "sampling": {"speed_rate_hz": 63.0},
            "log": {"swapped_share": 0.1, "dropout_share": 0.1},
        }
    )
    made = next(simulate_campaign(scenario))
    assert sum(frame.height for frame in made.topics.values()) > BLOCK_ROWS
    return made


class Message(NamedTuple):
    log_time_ns: int
    frame: str
    data: bytes


def serialised(log: SimulatedLog, store: Typestore, *, ros1: bool) -> Iterator[Message]:
    """All messages in order, each by itself with rosbags."""
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    found: list[Message] = []
    for name, frame in log.topics.items():
        kind = TOPICS[name].msgtype
        column = make_message_columns(name, frame, log.scenario)
        for row, time_ns in enumerate(frame["log_time_ns"]):
            message = _message(store, kind, column, row)
            found.append(Message(time_ns, name, bytes(serialize(message, kind))))
    return iter(sorted(found, key=lambda message: message.log_time_ns))


def _message(store: Typestore, name: str, column: Any, row: int) -> Any:
    """One message of columns, as an object."""
    fields: dict[str, Any] = {}
    for field, (node, detail) in store.fielddefs[name][1]:
        value = column.get(field)
        if isinstance(value, dict) or node.name == "NAME":
            fields[field] = _message(store, detail, value or {}, row)
        elif value is None:
            fields[field] = np.zeros(detail[1])
        elif isinstance(value, np.ndarray):
            fields[field] = value[row].copy() if value.ndim == 2 else value[row].item()
        else:
            fields[field] = list(value) if isinstance(value, tuple) else value
    return store.types[name](**fields)


@pytest.mark.heavy
def test_a_bag_is_the_one_that_rosbags_writes(log: SimulatedLog, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with BagWriter(tmp_path / "theirs.bag") as bag:
        connections = {
            name: bag.add_connection(topic.name, topic.msgtype, typestore=store)
            for name, topic in TOPICS.items()
            if name in log.topics
        }
        for message in serialised(log, store, ros1=True):
            bag.write(connections[message.frame], message.log_time_ns, message.data)
    write_bag(log, tmp_path / "ours.bag")
    assert (tmp_path / "ours.bag").read_bytes() == (tmp_path / "theirs.bag").read_bytes()


@pytest.mark.heavy
def test_an_mcap_file_is_the_one_that_its_library_writes(log: SimulatedLog, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with (tmp_path / "theirs.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="payscope")
        channels: dict[str, int] = {}
        for name in log.topics:
            topic = TOPICS[name]
            definition, _ = store.generate_msgdef(topic.msgtype, ros_version=2)
            schema = writer.register_schema(topic.msgtype, "ros2msg", definition.encode())
            channels[name] = writer.register_channel(topic.name, "cdr", schema)
        for time_ns, name, data in serialised(log, store, ros1=False):
            writer.add_message(channels[name], time_ns, data, time_ns)
        writer.finish()
    write_mcap(log, tmp_path / "ours.mcap")
    assert (tmp_path / "ours.mcap").read_bytes() == (tmp_path / "theirs.mcap").read_bytes()


@pytest.mark.heavy
def test_a_rosbag2_directory_holds_the_messages_of_rosbags_for_every_reader(
    log: SimulatedLog, tmp_path: Path
) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    expected = [
        (m.log_time_ns, TOPICS[m.frame].name, m.data) for m in serialised(log, store, ros1=False)
    ]
    write_rosbag2(log, tmp_path / "log")
    with AnyReader([tmp_path / "log"]) as reader:
        found = [(time, which.topic, bytes(data)) for which, time, data in reader.messages()]
        assert reader.message_count == len(expected)
    assert sorted(found) == sorted(expected)
    with (tmp_path / "log" / "log.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        read = [(m.log_time, c.topic, m.data) for _, c, m in reader.iter_messages()]
        metadata = [record.name for record in reader.iter_metadata()]
    assert sorted(read) == sorted(expected)
    assert metadata == ["rosbag2"]
    with open_log(tmp_path / "log") as ours:
        assert ours.topics()["messages"].sum() == len(expected)
        assert not ours.losses()


@pytest.mark.heavy
def test_a_database_holds_the_messages_of_rosbags(log: SimulatedLog, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    expected = [
        (message.log_time_ns, TOPICS[message.frame].name, message.data)
        for message in serialised(log, store, ros1=False)
    ]
    write_db3(log, tmp_path / "log.db3")
    assert [path.name for path in tmp_path.iterdir()] == ["log.db3"]
    with AnyReader([tmp_path / "log.db3"]) as reader:
        found = [(time, which.topic, bytes(data)) for which, time, data in reader.messages()]
    assert sorted(found) == sorted(expected)
    with open_log(tmp_path / "log.db3") as ours:
        assert ours.topics()["messages"].sum() == len(expected)
        assert not ours.losses()


def test_a_log_without_messages_is_whole(log: SimulatedLog, tmp_path: Path) -> None:
    from dataclasses import replace

    empty = replace(log, topics={name: frame.clear() for name, frame in log.topics.items()})
    write_bag(empty, tmp_path / "none.bag")
    write_mcap(empty, tmp_path / "none.mcap")
    write_rosbag2(empty, tmp_path / "none")
    write_db3(empty, tmp_path / "none.db3")
    with (tmp_path / "none.mcap").open("rb") as file:
        assert not list(make_reader(file, validate_crcs=True).iter_messages())
    with AnyReader([tmp_path / "none.bag"]) as reader:
        assert reader.message_count == 0


@pytest.mark.parametrize("threshold", [10, 64, 100, 1000])
def test_a_chunk_ends_with_the_record_that_takes_it_beyond_its_size(threshold: int) -> None:
    rng = np.random.default_rng(threshold)
    lengths = rng.integers(1, 40, 200)
    data = rng.integers(0, 256, int(lengths.sum()), np.uint8)
    blocks: list[RecordBlock] = []
    for rows in np.array_split(np.arange(200), [7, 7, 90, 91]):
        ends = np.cumsum(lengths[rows])
        first = int(lengths[: rows[0]].sum()) if rows.size else 0
        size = int(ends[-1]) if rows.size else 0
        blocks.append(RecordBlock(data[first : first + size], rows % 3, rows * 10, ends))
    preamble = b"definitions"
    made = list(split_into_chunks(iter(blocks), preamble, threshold))
    whole = b"".join(chunk.data.tobytes() for chunk in made)
    assert whole == preamble + data.tobytes()
    assert np.concatenate([chunk.log_times for chunk in made]).tolist() == list(range(0, 2000, 10))
    for number, chunk in enumerate(made):
        begin = len(preamble) if number == 0 else 0
        assert chunk.offsets[-1] <= max(threshold, begin)
        assert chunk.data.size > threshold or number == len(made) - 1
        mine = lengths[chunk.log_times // 10]
        assert chunk.offsets.tolist() == (begin + np.cumsum(mine) - mine).tolist()
