"""Compile message types from the definitions in a log or of a ROS 2 release.

Each type is compiled by itself, so that a definition that cannot be parsed (as of service `_Event`
types, for which rosbag2 stores the service's) loses only its topic and not the log.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from textwrap import shorten
from typing import Any, Final

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from estimators.errors import join_to_one_line
from replay.logs.log_limits import LIMITS
from replay.logs.messages.broken_bytes import BROKEN_BYTES, BrokenBytesError
from replay.logs.messages.message_types import (
    COLUMN_DTYPES,
    STAMP_TYPES,
    FieldType,
    ListOf,
    MessageType,
    RecordType,
    Scalar,
    ValueNames,
)
from replay.logs.storage import Connection

#: Releases whose bags store no definitions, newest first, then the latest release for newer types.
_RELEASES: Final = (
    Stores.ROS2_HUMBLE,
    Stores.ROS2_GALACTIC,
    Stores.ROS2_FOXY,
    Stores.ROS2_ELOQUENT,
    Stores.ROS2_DASHING,
    Stores.LATEST,
)
_DECODABLE: Final = {
    "ros1": ("ros1msg",),
    "cdr": ("ros2msg", "ros2idl", ""),
    "json": ("jsonschema",),
    "protobuf": ("protobuf",),
}
_IDL_SEPARATOR: Final = "=" * 80 + "\n"
_INTEGERS: Final = frozenset(
    ("byte", "char", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
)
#: line between request and response
_SERVICE_RULE: Final = "---"
#: member that rosbags gives an empty ROS 2 message, for the byte that DDS sends
_PLACEHOLDER: Final = "structure_needs_at_least_one_member"
_EMPTY_STRUCT: Final = re.compile(r"(struct\s+\w+\s*\{)\s*\}")


class DefinitionError(Exception):
    """Raised if messages of a connection cannot be decoded; one line with the reason."""

    def __init__(self, text: str) -> None:
        super().__init__(join_to_one_line(text))


def make_message_type_of_connection(connection: Connection) -> MessageType:
    """Compile the message type of a connection.

    Raises:
        DefinitionError: its encoding has no decoder, or its definition cannot be used.
    """
    return _make_type_from_ros_definition(replace(connection, id=0, topic=""))


#: Logs of a fleet share their types, and parsing one takes milliseconds.
@lru_cache(maxsize=256)
def _make_type_from_ros_definition(connection: Connection) -> MessageType:
    formats = _DECODABLE.get(connection.encoding)
    if formats is None or connection.definition_format not in formats:
        kind = shorten(connection.definition_format, 80) or "no"
        raise DefinitionError(
            f"no decoder for encoding '{connection.encoding}' with {kind} definition; "
            "there is one for cdr (ros2msg, ros2idl), ros1 (ros1msg), json (jsonschema), protobuf"
        )
    if connection.encoding in ("json", "protobuf"):
        return _make_type_from_json_or_protobuf(connection)
    if _SERVICE_RULE in connection.definition.split("\n"):
        raise DefinitionError(
            f"the log holds the definition of a service in place of {connection.type}, as "
            "rosbag2 stores it for service events, so the messages of this topic cannot be decoded"
        )
    if _is_empty_message_type(connection):
        return MessageType(RecordType(connection.type, ()), ros1=False, decode=lambda _: None)
    store = _make_typestore_of_connection(connection)
    record = _DefinitionConverter(store, ros1=connection.encoding == "ros1").make_record_type(
        connection.type
    )
    return MessageType(
        record, connection.encoding == "ros1", _make_bytes_decoder(store, connection)
    )


def _is_empty_message_type(connection: Connection) -> bool:
    """Whether the type is a package's own `Empty`, whose definition is an empty text."""
    is_named = connection.type.rpartition("/")[2] == "Empty" and connection.encoding == "cdr"
    return is_named and not connection.definition.strip()


def _make_type_from_json_or_protobuf(connection: Connection) -> MessageType:
    """Make a message type from a JSON schema or protobuf descriptors."""
    try:
        if connection.encoding == "json":
            from replay.logs.json_types import make_message_type_from_json_schema

            return make_message_type_from_json_schema(connection.type, connection.definition)
        from replay.logs.protobuf_types import make_message_type_from_protobuf

        descriptors = connection.definition.encode(errors="surrogateescape")
        return make_message_type_from_protobuf(connection.type, descriptors)
    except BrokenBytesError as error:
        reason = shorten(str(error), 160)
        raise DefinitionError(
            f"the definition of {connection.type} cannot be used: {reason}"
        ) from error


def _make_typestore_of_connection(connection: Connection) -> Typestore:
    text = connection.definition
    if not text.strip() and connection.definition_format in ("", "ros2msg"):
        return _find_typestore_with_type(connection.type)
    store = get_typestore(Stores.EMPTY)
    # rosbag2 joins IDL files with a separator line and a line "IDL: name"
    is_idl = connection.definition_format == "ros2idl"
    is_joined = is_idl and text.startswith(f"{_IDL_SEPARATOR}IDL: ")
    joined = text.split(_IDL_SEPARATOR)[1:]
    parts = [idl.partition("\n")[2] for idl in joined] if is_joined else [text]
    if is_idl:  # rosbags' grammar requires a member in every struct
        parts = [_EMPTY_STRUCT.sub(rf"\1 uint8 {_PLACEHOLDER}; }}", part) for part in parts]
    types: Typesdict = {}
    try:
        for part in parts:
            types |= (
                get_types_from_idl(part) if is_idl else get_types_from_msg(part, connection.type)
            )
        store.register(types)
    except (TypesysError, SyntaxError, *BROKEN_BYTES) as error:
        reason = shorten(str(error), 160)
        raise DefinitionError(
            f"the definition of {connection.type} cannot be parsed: {reason}"
        ) from error
    return store


def _find_typestore_with_type(name: str) -> Typestore:
    """Find the type store of the first listed ROS 2 release that has a type."""
    for release in _RELEASES:
        store = get_typestore(release)
        if name in store.fielddefs:
            return store
    if not name:
        raise DefinitionError("the log does not state the message type of this topic")
    raise DefinitionError(
        f"the log carries no definition of {name}, and no ROS 2 release knows the type; "
        "record it with ROS 2 Iron or newer, which stores definitions"
    )


class _DefinitionConverter:
    """Converter of definitions, with the types that they refer to, to record types."""

    def __init__(self, store: Typestore, *, ros1: bool) -> None:
        self._store = store
        self._byte = Scalar("int8" if ros1 else "uint8")
        self._left = LIMITS.definition_fields

    def make_record_type(
        self, name: str, enclosing_types: tuple[str, ...] = (), repetitions: int = 1
    ) -> RecordType:
        if name in enclosing_types:
            raise DefinitionError(f"the definition of {name} contains itself")
        if name not in self._store.fielddefs:
            user = f", used by {enclosing_types[-1]}," if enclosing_types else ""
            raise DefinitionError(f"the definition of {name}{user} is missing")
        if len(enclosing_types) == LIMITS.definition_depth:
            raise DefinitionError(
                f"the definition of {enclosing_types[0]} is nested deeper than "
                f"{LIMITS.definition_depth} levels, the most that can be decoded"
            )
        within = (*enclosing_types, name)
        fields: list[tuple[str, FieldType]] = []
        for field, description in self._store.fielddefs[name][1]:
            self._left -= 1
            if self._left < 0:
                raise DefinitionError(
                    f"{within[0]} has more than {LIMITS.definition_fields} fields, the most that "
                    "can be decoded"
                )
            if field != _PLACEHOLDER:
                fields.append((field, self._make_type_of_field(description, within, repetitions)))
        return RecordType(
            name, tuple(fields), parse_enumerated_value_names(self._store.fielddefs[name])
        )

    def _make_type_of_field(
        self, description: Any, enclosing_types: tuple[str, ...], repetitions: int
    ) -> FieldType:
        node, detail = description
        if node == Nodetype.NAME:
            # rosbags refuses other definitions of these
            if detail in STAMP_TYPES:
                return Scalar("stamp")
            return self.make_record_type(detail, enclosing_types, repetitions)
        if node == Nodetype.BASE:
            kind = detail[0]
            if kind not in COLUMN_DTYPES:
                raise DefinitionError(
                    f"{enclosing_types[-1]} has a field of type {kind}, which is not supported"
                )
            return self._byte if kind == "byte" else Scalar(kind)
        length = detail[1] if node == Nodetype.ARRAY else None
        element = self._make_type_of_field(detail[0], enclosing_types, repetitions * (length or 1))
        assert not isinstance(element, ListOf), "ROS has no lists of lists"
        if length is not None:
            numbers = isinstance(element, Scalar) and element.kind != "string"
            most = LIMITS.array_elements if numbers else LIMITS.object_array_elements // repetitions
            if length > most:
                raise DefinitionError(
                    f"{enclosing_types[-1]} has an array of {length} elements, "
                    "which is not supported"
                )
        return ListOf(element, length)


def parse_enumerated_value_names(definition: Any) -> tuple[tuple[str, ValueNames], ...]:
    """Find the enumerated fields of a definition, and the names of their values.

    ROS has constants and no enumerations. A constant belongs to the integer field whose name in
    capitals is its prefix (`STATUS_FIX` to `status`); if no constant has such a prefix, all of one
    type belong to the only field of that type (`ERROR` to the `level` of a DiagnosticStatus).
    """
    constants, described = definition
    numbers = [(n, kind, v) for n, kind, v in constants if type(v) is int and kind != "bool"]
    integers = {
        name: detail[0]
        for name, (node, detail) in described
        if node == Nodetype.BASE and detail[0] in _INTEGERS
    }
    # longest name first: STATUS_CODE_OK belongs to `status_code`, if there is one, not to `status`
    by_length = sorted(integers, key=len, reverse=True)
    found: dict[str, dict[int, str]] = {}
    for constant, _, value in numbers:
        owner = next((f for f in by_length if constant.startswith(f"{f.upper()}_")), None)
        if owner is not None:
            found.setdefault(owner, {}).setdefault(value, constant)
    if not found:
        for kind in {kind for _, kind, _ in numbers}:
            owners = [name for name, of_kind in integers.items() if of_kind == kind]
            if len(owners) == 1:
                for constant, constant_kind, value in numbers:
                    if constant_kind == kind:
                        found.setdefault(owners[0], {}).setdefault(value, constant)
    return tuple((name, tuple(values.items())) for name, values in found.items())


def _make_bytes_decoder(typestore: Typestore, connection: Connection) -> Callable[[bytes], Any]:
    ros1 = connection.encoding == "ros1"
    deserialize = typestore.deserialize_ros1 if ros1 else typestore.deserialize_cdr

    def decode_message(data: bytes) -> Any:
        try:
            return deserialize(data, connection.type)
        # NameError: the code that rosbags generates for a long double calls an undefined function
        except (SerdeError, *BROKEN_BYTES, NameError) as error:
            raise BrokenBytesError(error) from error

    return decode_message
