"""Message types as trees, independent of the library that parsed the definition."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import polars as pl

from replay.logs.messages.decoding_libraries import ROSBAGS, DecodingLibrary

STAMP_TYPES: Final = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
HEADER_TYPE: Final = "std_msgs/msg/Header"

#: Data type of a scalar in a column: a stamp is in nanoseconds, uint64 keeps its full range.
COLUMN_DTYPES: Final[dict[str, pl.DataType]] = {
    "bool": pl.Boolean(),
    "string": pl.String(),
    "wstring": pl.String(),
    "float32": pl.Float64(),
    "float64": pl.Float64(),
    "float128": pl.Float64(),
    "uint64": pl.UInt64(),
    "stamp": pl.Int64(),
    **dict.fromkeys(
        ("byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64"),
        pl.Int64(),
    ),
}

#: Data type of a scalar in a column of lists, where a number keeps its size: an image stays bytes.
ELEMENT_DTYPES: Final[dict[str, pl.DataType]] = {
    **COLUMN_DTYPES,
    "float32": pl.Float32(),
    "byte": pl.Int8(),
    "int8": pl.Int8(),
    "int16": pl.Int16(),
    "int32": pl.Int32(),
    "char": pl.UInt8(),
    "uint8": pl.UInt8(),
    "uint16": pl.UInt16(),
    "uint32": pl.UInt32(),
}


#: The values of an enumeration with their names.
ValueNames: TypeAlias = tuple[tuple[int, str], ...]


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number, a string, or a stamp (time or duration, in ns)."""

    kind: str


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list of scalars or messages; `length` is None if it varies."""

    element: "Scalar | RecordType"
    length: int | None


@dataclass(frozen=True, slots=True)
class RecordType:
    """A message type: its fields in order."""

    name: str
    fields: tuple[tuple[str, "FieldType"], ...]
    #: fields that are enumerations, with their values and the names of these
    value_names: tuple[tuple[str, "ValueNames"], ...] = field(default=(), compare=False)

    def type_of_field(self, name: str) -> "FieldType | None":
        """Type of a field; None if it does not exist."""
        return dict(self.fields).get(name)

    @property
    def has_header(self) -> bool:
        """Whether its messages carry a header stamp."""
        header = self.type_of_field("header")
        return (
            isinstance(header, RecordType)
            and header.name == HEADER_TYPE
            and header.type_of_field("stamp") == Scalar("stamp")
        )

    @property
    def has_field_of_element_names(self) -> bool:
        """Whether list elements can be selected by the names in its list `name`."""
        return self.type_of_field("name") == ListOf(Scalar("string"), None)


FieldType = Scalar | ListOf | RecordType


@dataclass(frozen=True, slots=True)
class MessageType:
    """Type of a topic's messages, and the function that decodes one message."""

    record: RecordType
    ros1: bool
    decode: Callable[[bytes], Any]
    #: library whose objects `decode` returns
    library: DecodingLibrary = ROSBAGS


@dataclass(frozen=True, slots=True)
class LeafField:
    """Part of a message that can be a column."""

    #: dotted name; a list shows as `effort[]`
    name: str
    #: data type of the column that `Log.read` returns
    dtype: pl.DataType
    #: lengths of the nested lists, from the outside in; None if a length varies
    lengths: tuple[int | None, ...] = ()
    value_names: ValueNames = ()
    #: whether it is the stamp of a header, in ns since 1970
    is_stamp: bool = False


def iter_leaf_fields_of_message_type(
    record: RecordType, prefix: str = "", lengths: tuple[int | None, ...] = ()
) -> Iterator[LeafField]:
    """Yield every part of a message that can be a column, in the order of the definition."""
    named = dict(record.value_names)
    for name, kind in record.fields:
        path, inner, around = f"{prefix}{name}", kind, lengths
        if isinstance(kind, ListOf):
            path, inner, around = f"{path}[]", kind.element, (*lengths, kind.length)
        if isinstance(inner, RecordType):
            yield from iter_leaf_fields_of_message_type(inner, f"{path}.", around)
            continue
        assert isinstance(inner, Scalar), "there are no lists of lists"
        dtype = (ELEMENT_DTYPES if around else COLUMN_DTYPES)[inner.kind]
        for _ in around:
            dtype = pl.List(dtype)
        is_stamp = record.name == HEADER_TYPE and inner.kind == "stamp"
        yield LeafField(path, dtype, around, named.get(name, ()), is_stamp)


def iter_leaf_paths_of_message_type(message_type: RecordType) -> Iterator[str]:
    """Yield the dotted names of all possible columns; a list shows as `effort[]`."""
    return (leaf.name for leaf in iter_leaf_fields_of_message_type(message_type))
