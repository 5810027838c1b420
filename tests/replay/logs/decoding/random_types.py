"""Random message types and random messages of them, in every encoding."""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import Any

import numpy as np
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from replay.logs.message_definitions import make_message_type_of_connection
from replay.logs.messages.message_fields import ALL
from replay.logs.messages.message_types import FieldType, ListOf, MessageType, RecordType
from replay.logs.messages.raw_batch import RawBatch, make_batch_of_messages
from replay.logs.storage.container import Connection

#: with the codes of `struct`
NUMBERS = {
    "bool": "?",
    "byte": "b",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
#: with lengths around what fits into a view of it
NAMES = ("left", "right", "", "Größe", "boom.lift-1", "boom.lift-12", "bucket/cylinder/left")
TIME = "builtin_interfaces/msg/Time"


@dataclass(frozen=True)
class Types:
    """Definitions `A`, `B` … of which each uses only later ones; `A` is the message."""

    #: by type: (type with {time} and {duration} for what ROS 1 and 2 call differently, name)
    definitions: tuple[tuple[tuple[str, str], ...], ...]

    def text(self, *, ros1: bool) -> str:
        times = (
            {"time": "time", "duration": "duration"}
            if ros1
            else {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}
        )
        parts = [
            "".join(f"{kind.format(**times)} {name}\n" for kind, name in fields)
            for fields in self.definitions
        ]
        rule = "=" * 80
        later = (f"{rule}\nMSG: t/{chr(ord('A') + i)}\n{part}" for i, part in enumerate(parts))
        return parts[0] + "".join(list(later)[1:])


@st.composite
def types(draw: st.DrawFn) -> Types:
    """Types with everything that a definition can say, but lists of empty messages.

    Those are what rosbags builds one by one even where a damaged message claims four billion.
    """
    count = draw(st.integers(1, 4))
    definitions = []
    for i in range(count):
        later = [f"t/{chr(ord('A') + j)}" for j in range(i + 1, count)]
        plain = st.sampled_from([*NUMBERS, "string", "string<=20", "{time}", "{duration}", *later])
        suffix = st.sampled_from(["", "", "", "[]", "[1]", "[3]", "[<=4]"])
        kinds = draw(st.lists(st.tuples(plain, suffix), min_size=1, max_size=6))
        fields = [(f"{kind}{many}", f"f{k}") for k, (kind, many) in enumerate(kinds)]
        if draw(st.booleans()):
            fields.insert(draw(st.integers(0, len(fields))), ("string[]", "name"))
        definitions.append(tuple(fields))
    return Types(tuple(definitions))


@dataclass(frozen=True)
class Sample:
    """Messages of a type in one encoding."""

    types: Types
    encoding: str
    seed: int
    count: int = 5

    @property
    def ros1(self) -> bool:
        return self.encoding == "ros1"

    @cached_property
    def kind(self) -> MessageType:
        """The type, compiled from its text as a log's would be."""
        encoding, fmt = ("ros1", "ros1msg") if self.ros1 else ("cdr", "ros2msg")
        text = self.types.text(ros1=self.ros1)
        return make_message_type_of_connection(Connection(0, "/t", "t/msg/A", encoding, text, fmt))

    @cached_property
    def store(self) -> Typestore:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(self.types.text(ros1=self.ros1), "t/msg/A"))
        return store

    @cached_property
    def values(self) -> list[Any]:
        rng = Random(self.seed)
        return [random_message(self.store, "t/msg/A", rng) for _ in range(self.count)]

    def stored(self, encoding: str) -> list[bytes]:
        return [encode(self.store, value, encoding) for value in self.values]


def encode(store: Typestore, value: Any, encoding: str) -> bytes:
    """A message in CDR, plain XCDR2 (`xcdr2_le`, `xcdr2_be`) or ROS 1."""
    name = value.__msgtype__
    if encoding == "ros1":
        return bytes(store.serialize_ros1(value, name))
    if encoding.startswith("xcdr2"):
        return Xcdr2(store, ">" if encoding.endswith("be") else "<").message(value)
    return bytes(store.serialize_cdr(value, name, little_endian=encoding == "cdr_le"))


def batch_of(stored: Sequence[bytes]) -> RawBatch:
    return make_batch_of_messages(0, range(len(stored)), stored)


def random_message(store: Typestore, name: str, rng: Random) -> Any:
    fields = {
        field: _random_value(store, description, rng, named=field == "name")
        for field, description in store.fielddefs[name][1]
    }
    return store.types[name](**fields)


def _random_value(store: Typestore, description: Any, rng: Random, *, named: bool = False) -> Any:
    node, detail = description
    if node == Nodetype.NAME:
        if detail == TIME or detail.endswith("/Duration"):
            return store.types[detail](
                sec=rng.randrange(-(2**31), 2**31), nanosec=rng.randrange(2**32)
            )
        return random_message(store, detail, rng)
    if node == Nodetype.BASE:
        return _random_scalar(detail[0], rng, named=named)
    element, limit = detail
    length = limit if node == Nodetype.ARRAY else rng.randrange((limit or 5) + 1)
    values = [_random_value(store, element, rng, named=named) for _ in range(length)]
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        dtype = {"bool": "bool", "char": "uint8", "byte": "int8"}.get(element[1][0], element[1][0])
        return np.array(values, dtype)
    return values


def _random_scalar(kind: str, rng: Random, *, named: bool) -> Any:
    if kind == "bool":
        return rng.random() < 0.5
    if kind == "string":
        if named:
            return rng.choice(NAMES)
        return "".join(rng.choice("abcé→🚜\0 ") for _ in range(rng.randrange(6)))
    if kind == "float32":
        bits = rng.getrandbits(32)
        # a signalling NaN becomes quiet as soon as a processor converts it
        bits |= 0x400000 if bits & 0x7F800000 == 0x7F800000 and bits & 0x7FFFFF else 0
        return np.uint32(bits).view(np.float32).item()
    if kind == "float64":
        special = [float("nan"), float("-inf"), -0.0, 5e-324]
        drawn = struct.unpack("<d", rng.randbytes(8))[0]
        return rng.choice([drawn, rng.uniform(-9, 9), rng.choice(special)])
    dtype = np.iinfo({"char": "uint8", "byte": "int8"}.get(kind, kind))
    return rng.choice([dtype.min, dtype.max, rng.randrange(int(dtype.min), int(dtype.max) + 1)])


def every_field(record: RecordType) -> Iterator[str]:
    """Every value of a message: leaves of it, of whole lists, and of elements by index and name."""
    for name, kind in record.fields:
        if isinstance(kind, ListOf):
            picks = [ALL, *range(min(kind.length or 3, 3))]
            picks += ["left", "Größe"] if record.has_field_of_element_names else []
            for pick in picks:
                yield from _leaves(f"{name}[{pick}]", kind.element)
        else:
            yield from _leaves(name, kind)


def _leaves(path: str, kind: FieldType) -> Iterator[str]:
    if isinstance(kind, RecordType):
        yield from (f"{path}.{leaf}" for leaf in every_field(kind))
    else:
        yield path


class Xcdr2:
    """Plain XCDR2, written from XTypes 1.3 (7.4.3) to test against: rosbags has none."""

    def __init__(self, store: Typestore, order: str) -> None:
        self._store = store
        self._order = order
        self._out = bytearray()

    def message(self, value: Any) -> bytes:
        self._record(value, value.__msgtype__)
        head = bytes([0, 6 + (self._order == "<"), 0, -len(self._out) % 4])
        return head + bytes(self._out) + bytes(-len(self._out) % 4)

    def _record(self, value: Any, name: str) -> None:
        for field, description in self._store.fielddefs[name][1]:
            self._value(getattr(value, field), description)

    def _value(self, value: Any, description: Any) -> None:
        node, detail = description
        if node == Nodetype.NAME:
            self._record(value, detail)
        elif node == Nodetype.BASE:
            self._scalar(value, detail[0])
        else:
            element, _ = detail
            primitive = element[0] == Nodetype.BASE and element[1][0] != "string"
            if not primitive:
                self._number(0, "I")
                begin = len(self._out)
            if node == Nodetype.SEQUENCE:
                self._number(len(value), "I")
            for one in value:
                self._value(one, element)
            if not primitive:
                size = struct.pack(f"{self._order}I", len(self._out) - begin)
                self._out[begin - 4 : begin] = size

    def _scalar(self, value: Any, kind: str) -> None:
        if kind == "string":
            text = value.encode() + b"\0"
            self._number(len(text), "I")
            self._out += text
        else:
            self._number(value, NUMBERS[kind])

    def _number(self, value: Any, code: str) -> None:
        packed = struct.pack(self._order + code, value)
        self._out += bytes(-len(self._out) % min(len(packed), 4))
        self._out += packed
