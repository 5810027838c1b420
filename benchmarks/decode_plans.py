"""Messages a second: the columnar decoder against rosbags on the same bytes.

    .venv/bin/python -P benchmarks/decode_plans.py [ROWS]

Both decode the same messages, which lie in memory, on one thread: rosbags into an object each, the
plan into a frame of every field, lists as a whole, in batches of ROWS (4096). Reading and
decompressing files is not part of it, nor is the first use, which compiles once for a machine.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.decode_log import CUSTOM_TYPE, store, value
from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.message_definitions import make_message_type_of_connection
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.message_types import iter_leaf_paths_of_message_type
from replay.logs.messages.raw_batch import RawBatch, make_batch_of_messages
from replay.logs.storage.container import Connection

TOPICS: Final = (
    "sensor_msgs/msg/Imu",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/JointState",
    CUSTOM_TYPE,
    "sensor_msgs/msg/NavSatFix",
    "geometry_msgs/msg/TwistStamped",
)
MESSAGES: Final = 40_000
ROUNDS: Final = 5


def main() -> None:
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 4096
    types = store(ros1=False)
    rng = np.random.default_rng(0)
    print(f"{'type':32}{'bytes':>6}{'fields':>7}{'rosbags ns':>12}{'plan ns':>9}{'ratio':>7}")
    totals = np.zeros(2)
    for name in TOPICS:
        text, _ = types.generate_msgdef(name, ros_version=2)
        kind = make_message_type_of_connection(Connection(0, "/t", name, "cdr", text, "ros2msg"))
        fields = [
            resolve_message_field(leaf, kind.record)
            for leaf in iter_leaf_paths_of_message_type(kind.record)
        ]
        stored = [bytes(types.serialize_cdr(value(types, name, rng), name)) for _ in range(rows)]
        batch = make_batch_of_messages(0, range(len(stored)), stored)
        batches = [batch] * (MESSAGES // rows)
        plan = DecodePlan(kind.record, ros1=False, fields=fields)
        by_rosbags = _best(partial(_rosbags, kind.decode, stored)) / rows
        by_plan = _best(partial(_plan, plan, batches)) / (len(batches) * rows)
        each = np.array([by_rosbags, by_plan]) * 1e9
        totals += each
        print(
            f"{name:32}{len(stored[0]):6}{len(fields):7}{each[0]:12.0f}{each[1]:9.0f}"
            f"{each[0] / each[1]:7.1f}"
        )
    mean = totals / len(TOPICS)
    print(f"{'mix':45}{mean[0]:12.0f}{mean[1]:9.0f}{mean[0] / mean[1]:7.1f}")
    print(f"{1e3 / mean[1]:.2f} million messages a second, all fields, one thread")


def _rosbags(decode: Callable[[bytes], Any], stored: list[bytes]) -> None:
    for data in stored:
        decode(data)


def _plan(plan: DecodePlan, batches: list[RawBatch]) -> None:
    for batch in batches:
        assert plan.decode(batch).undecodable == 0


def _best(work: Callable[[], None]) -> float:
    seconds: list[float] = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


if __name__ == "__main__":
    main()
