"""Who else reads logs: each as its documentation says, into what it gives by itself.

A slow peer stops after `most` messages; what it took to open the file is timed by itself, so that
the rate of the messages is its own. None of the peers that give objects makes columns of them,
which their users would have to add.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, Final

from benchmarks.decode_log import CUSTOM, CUSTOM_TYPE

#: Opens a file and gives what goes through its messages, to be taken one by one.
Peer = Callable[[Path], Any]


@contextmanager
def rosbags(path: Path) -> Iterator[Iterator[object]]:
    """`AnyReader`: a dataclass a message. Its type store knows ROS 2's types, for `.db3` too."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(CUSTOM, CUSTOM_TYPE))
    source = path.parent if path.suffix == ".db3" else path
    with AnyReader([source], default_typestore=store) as reader:
        yield (
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        )


@contextmanager
def mcap_ros2(path: Path) -> Iterator[Iterator[object]]:
    """The official reader with `mcap-ros2-support`: a namespace a message."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        yield (decoded for *_, decoded in reader.iter_decoded_messages())


@contextmanager
def mcap_ros2_fast(path: Path) -> Iterator[Iterator[object]]:
    """The official reader with `mcap-ros2-support-fast`."""
    from mcap.reader import make_reader
    from mcap_ros2_support_fast.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        yield (decoded for *_, decoded in reader.iter_decoded_messages())


@contextmanager
def rerun(path: Path) -> Iterator[Iterator[object]]:
    """Rerun's compiled reader: Arrow arrays, whole chunks at once."""
    from rerun.chunk import McapReader

    yield iter(McapReader(path, decoders=["ros2_reflection"]).stream())


PEERS: Final[dict[str, tuple[Peer, frozenset[str]]]] = {
    "rosbags AnyReader": (rosbags, frozenset({".mcap", ".bag", ".db3"})),
    "mcap-ros2-support": (mcap_ros2, frozenset({".mcap"})),
    "mcap-ros2-support-fast": (mcap_ros2_fast, frozenset({".mcap"})),
    "Rerun McapReader": (rerun, frozenset({".mcap"})),
}


def drain(items: Iterator[object], most: int | None) -> int:
    """Take messages, at most so many, and keep none; how many there were."""
    return sum(1 for _ in islice(items, most))
