"""How fast containers hand over messages, against reading, unpacking and checking alone.

    python benchmarks/containers.py [MINUTES]

writes one log of MINUTES (10) in each container: six topics at 100 Hz, Imu and JointState. Limit is
the same bytes read, unpacked by the same library and (MCAP) summed by the same CRC, without looking
for a message in them; for `.db3`, SQLite's own loop over the rows, which reading pages outdoes.
Shares are of processor seconds, which other work on the machine disturbs least.
"""

import bz2
import sqlite3
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np
import pyarrow as pa
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from replay.readers.containers.bag_file import BagFile
from replay.readers.containers.db3_file import Db3File
from replay.readers.containers.mcap_file import McapFile

TOPICS = {"/imu/a": 0, "/imu/b": 0, "/speed": 1, "/torque": 1, "/arm": 1, "/boom": 1}
TYPES = ("sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState")
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
Limit = Callable[[Path], None]


def messages(ros1: bool) -> list[tuple[bytes, bytes]]:
    """A minute of messages whose numbers are noise."""
    store = ROS1 if ros1 else ROS2
    kinds, rng = store.types, np.random.default_rng(1)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    vector, zeros = kinds["geometry_msgs/msg/Vector3"], np.zeros(9)
    found = []
    for k in range(6000):
        stamp = kinds["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=k * 10**5)
        number = {"seq": k} if ros1 else {}
        header = kinds["std_msgs/msg/Header"](**number, stamp=stamp, frame_id="base_link")
        noise = rng.normal(size=16)
        imu = kinds[TYPES[0]](
            header=header,
            orientation=kinds["geometry_msgs/msg/Quaternion"](*noise[:4]),
            orientation_covariance=zeros,
            angular_velocity=vector(*noise[4:7]),
            angular_velocity_covariance=zeros,
            linear_acceleration=vector(*noise[7:10]),
            linear_acceleration_covariance=zeros,
        )
        joints = kinds[TYPES[1]](
            header=header,
            name=["left", "right"],
            position=noise[10:12],
            velocity=noise[12:14],
            effort=noise[14:],
        )
        found.append(
            tuple(bytes(serialize(m, t)) for m, t in zip((imu, joints), TYPES, strict=True))
        )
    return found


def record(write: Callable[[str, int, bytes], None], steps: int, *, ros1: bool) -> None:
    minute = messages(ros1)
    for k in range(steps):
        for number, (topic, kind) in enumerate(TOPICS.items()):
            write(topic, 10**18 + k * 10**7 + number, minute[k % 6000][kind])


def write_mcap(path: Path, steps: int, compression: CompressionType) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start("ros2")
        texts = [ROS2.generate_msgdef(name, ros_version=2)[0].encode() for name in TYPES]
        schemas = [
            writer.register_schema(n, "ros2msg", t) for n, t in zip(TYPES, texts, strict=True)
        ]
        keys = {t: writer.register_channel(t, "cdr", schemas[kind]) for t, kind in TOPICS.items()}
        record(
            lambda t, time, data: writer.add_message(keys[t], time, data, time), steps, ros1=False
        )
        writer.finish()


def write_bag(path: Path, steps: int, compression: Any) -> None:
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        keys = {t: writer.add_connection(t, TYPES[k], typestore=ROS1) for t, k in TOPICS.items()}
        record(lambda t, time, data: writer.write(keys[t], time, data), steps, ros1=True)


def write_db3(path: Path, steps: int) -> None:
    with Writer2(path.parent / "db3", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        keys = {t: writer.add_connection(t, TYPES[k], typestore=ROS2) for t, k in TOPICS.items()}
        record(lambda t, time, data: writer.write(keys[t], time, data), steps, ros1=False)
    (path.parent / "db3/db3.db3").rename(path)


def unpack(data: bytes, compression: str, size: int) -> Any:
    if compression in ("", "none"):
        return data
    return bz2.decompress(data) if compression == "bz2" else pa.decompress(data, size, compression)


def mcap_limit(path: Path) -> Limit:
    with path.open("rb") as file:
        chunks = [
            (file.tell(), chunk.compression, chunk.uncompressed_size, len(chunk.data))
            for chunk in StreamReader(file, emit_chunks=True).records
            if type(chunk).__name__ == "Chunk"
        ]

    def limit(path: Path) -> None:
        with path.open("rb") as file:
            for end, compression, size, stored in chunks:
                file.seek(end - stored)
                zlib.crc32(unpack(file.read(stored), compression, size))

    return limit


def bag_limit(path: Path) -> Limit:
    with Reader1(path) as reader:
        chunks = [reader.chunks[info.pos] for info in reader.chunk_infos]
        heads = [path.read_bytes()[info.pos : info.pos + 200] for info in reader.chunk_infos]
    kinds = [head.partition(b"compression=")[2][:3].decode() for head in heads]
    sizes = [int.from_bytes(head.partition(b"size=")[2][:4], "little") for head in heads]

    def limit(path: Path) -> None:
        with path.open("rb") as file:
            for chunk, kind, size in zip(chunks, kinds, sizes, strict=True):
                file.seek(chunk.datapos)
                unpack(file.read(chunk.datasize), "" if kind == "non" else kind, size)

    return limit


def db3_limit(_: Path) -> Limit:
    def limit(path: Path) -> None:
        database = sqlite3.connect(path)
        for _ in database.execute("SELECT topic_id, timestamp, data FROM messages"):
            pass
        database.close()

    return limit


def read(open_container: Any, path: Path) -> tuple[int, int]:
    container = open_container(path)
    count = size = 0
    for batch in container.batches([c.id for c in container.connections], None, None):
        count += batch.rows
        size += int(batch.lengths.sum())
    container.close()
    return count, size


def timed(work: Callable[[], Any]) -> tuple[float, float]:
    """Seconds of the clock, and of all processors."""
    wall, cpu = perf_counter(), process_time()
    work()
    return perf_counter() - wall, process_time() - cpu


def main(minutes: float) -> None:
    steps = int(minutes * 6000)
    formats = Writer1.CompressionFormat
    cases: dict[str, tuple[Any, Any, Any]] = {
        **{
            f"{c.name.lower()}.mcap": (McapFile, mcap_limit, lambda p, c=c: write_mcap(p, steps, c))
            for c in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD)
        },
        **{
            f"{name}.bag": (BagFile, bag_limit, lambda p, c=c: write_bag(p, steps, c))
            for name, c in (("none", None), ("lz4", formats.LZ4), ("bz2", formats.BZ2))
        },
        "log.db3": (Db3File, db3_limit, lambda p: write_db3(p, steps)),
    }
    print("file            MB  messages    M/s   MB/s  CPU s  limit CPU s  of limit")
    with TemporaryDirectory() as folder:
        for name, (open_container, make_limit, write) in cases.items():
            write(path := Path(folder, name))
            compare(path, open_container, make_limit(path))
            path.unlink()


def compare(path: Path, open_container: Any, limit: Limit) -> None:
    count, size = read(open_container, path)  # warm, and the kernels compiled
    # pairs, since other work on the machine comes and goes
    pairs = [
        (timed(lambda: limit(path)), timed(lambda: read(open_container, path))) for _ in range(5)
    ]
    bound = min(cpu for (_, cpu), _ in pairs)
    wall, ours = (min(column) for column in zip(*(mine for _, mine in pairs), strict=True))
    print(
        f"{path.name:10} {path.stat().st_size / 1e6:7.1f} {count:9,} {count / wall / 1e6:6.2f} "
        f"{size / wall / 1e6:6.0f} {ours:6.3f} {bound:12.3f} {bound / ours:9.0%}"
    )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10)
