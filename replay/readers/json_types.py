"""Types of JSON messages, from the JSON schema that an MCAP file keeps of them."""

import json
from typing import Any, Final

from replay.messages.library import Library, int64
from replay.messages.types import FieldType, ListOf, MessageType, Record, Scalar

_KINDS: Final = {
    "number": "float64",
    "integer": "int64",
    "boolean": "bool",
    "string": "string",
}
#: how times and durations are written
_STAMPS: Final = ({"sec", "nsec"}, {"sec", "nanosec"})
_DEEPEST: Final = 32
_MOST_FIELDS: Final = 20_000

Schema = dict[str, Any]


def json_type(name: str, schema: str) -> MessageType:
    """The type that a JSON schema describes.

    Raises:
        ValueError: it is no JSON schema, describes no fields, or too many.
    """
    root = json.loads(schema or "{}")
    record = _Schema(root).field(root, 0)
    if not isinstance(record, Record) or not record.fields:
        raise ValueError("its JSON schema lists no properties")
    return MessageType(Record(name, record.fields), ros1=False, decode=_decode, library=JSON)


class _Schema:
    """Turns a schema into records, all of what it refers to inside them."""

    def __init__(self, root: Schema) -> None:
        self._root = root
        self._left = _MOST_FIELDS

    def field(self, schema: Any, depth: int) -> FieldType | None:
        """The type of a value; None for one that can be of several, which is left out."""
        schema = self._referred(schema)
        self._left -= 1
        if self._left < 0 or depth > _DEEPEST:
            raise ValueError(f"it has more than {_MOST_FIELDS} fields, or {_DEEPEST} levels")
        kinds = schema.get("type", "object" if "properties" in schema else [])
        allowed = {kinds} if isinstance(kinds, str) else {*kinds} - {"null"}
        if len(allowed) != 1:
            return None
        (kind,) = allowed
        if kind == "array":
            element = self.field(schema.get("items", {}), depth + 1)
            if element is None or isinstance(element, ListOf):
                return None
            return ListOf(element, None)
        if kind != "object":
            return Scalar(_KINDS[kind]) if kind in _KINDS else None
        properties: Schema = schema.get("properties", {})
        if set(properties) in _STAMPS:
            return Scalar("stamp")
        fields = ((_text(name), self.field(inner, depth + 1)) for name, inner in properties.items())
        return Record(
            str(schema.get("title", "object")),
            tuple((name, kind) for name, kind in fields if kind is not None),
        )

    def _referred(self, schema: Any) -> Schema:
        for _ in range(_DEEPEST):
            if not isinstance(schema, dict):
                return {}
            reference = schema.get("$ref")
            if not isinstance(reference, str) or not reference.startswith("#/"):
                return schema
            schema = self._root
            for step in reference.removeprefix("#/").split("/"):
                schema = schema[step]
        raise ValueError("its references go in circles")


def _text(name: str) -> str:
    name.encode()  # JSON can spell half of a character, which names no column
    return name


def _decode(data: bytes) -> Any:
    message = json.loads(data, parse_int=lambda digits: int64(int(digits)))
    if not isinstance(message, dict):
        raise ValueError("the message is no JSON object")
    return message


def _get(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, dict) else None


def _stamp_ns(stamp: Any) -> int:
    if not isinstance(stamp, dict):
        raise TypeError(f"{type(stamp).__name__} in the place of a time")
    nanoseconds = stamp.get("nsec", stamp.get("nanosec", 0))
    return int64(int(stamp["sec"]) * 10**9 + int(nanoseconds))


JSON: Final = Library("json", _get, _stamp_ns)
