"""Make message types of JSON messages from the JSON schemas in an MCAP file.

In schemas and in messages, JSON may have any value in any place: each value is checked before use.
"""

import json
from collections.abc import Sequence
from typing import Any, Final

from replay.logs.log_limits import LIMITS
from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.messages.decoding_libraries import (
    CONVERT,
    DecodingLibrary,
    require_number_fits_int64,
)
from replay.logs.messages.message_types import FieldType, ListOf, MessageType, RecordType, Scalar

_KINDS: Final = {
    "number": "float64",
    "integer": "int64",
    "boolean": "bool",
    "string": "string",
}
#: JSON's name of each kind of value, by the Python type that represents it.
_JSON_NAMES: Final = {
    "dict": "an object",
    "list": "a list",
    "str": "a text",
    "NoneType": "null",
    "bool": "true or false",
    "int": "a number",
    "float": "a number",
}
#: names of the members of a time or duration
_STAMPS: Final = ({"sec", "nsec"}, {"sec", "nanosec"})


def make_message_type_from_json_schema(name: str, schema: str) -> MessageType:
    """Make a message type from a JSON schema.

    Raises:
        BrokenBytesError: the text is not a JSON schema, or describes no or too many fields.
    """
    root = _parse_json_schema(schema or "{}")
    record = _Schema(root).make_type_of_value(root, 0)
    # an object without properties is a message without fields, of which only the time is known
    is_object = isinstance(root, dict) and root.get("type") == "object"
    is_empty = is_object and not root.get("properties")
    if not isinstance(record, RecordType) or not (record.fields or is_empty):
        raise BrokenBytesError("its JSON schema lists no properties")
    return MessageType(
        RecordType(name, record.fields), ros1=False, decode=_decode_json_message, library=JSON
    )


def _parse_json_schema(text: str | bytes) -> Any:
    try:
        # Python itself refuses numbers of thousands of digits; here, those beyond 64 bits
        return json.loads(text, parse_int=lambda digits: require_number_fits_int64(int(digits)))
    except (ValueError, RecursionError) as error:
        raise BrokenBytesError(error) from error


class _Schema:
    """Converter of a JSON schema, whose references it follows, to record types."""

    def __init__(self, root: Any) -> None:
        self._root = root
        self._left = LIMITS.json_fields

    def make_type_of_value(self, schema: Any, depth: int) -> FieldType | None:
        """Type of a value by its schema; None if it may have several types, and is left out."""
        schema = self._follow_schema_reference(schema)
        self._left -= 1
        if self._left < 0 or depth > LIMITS.json_depth:
            raise BrokenBytesError(
                f"its JSON schema has more than {LIMITS.json_fields} fields, or is nested deeper "
                f"than {LIMITS.json_depth} levels"
            )
        kind = find_sole_type_of_schema(schema)
        if kind == "array":
            element = self.make_type_of_value(schema.get("items", {}), depth + 1)
            if element is None or isinstance(element, ListOf):
                return None
            return ListOf(element, None)
        if kind != "object":
            return Scalar(_KINDS[kind]) if kind in _KINDS else None
        properties = schema.get("properties", {})
        if not isinstance(properties, dict):
            raise BrokenBytesError("the properties in its JSON schema are not a JSON object")
        if set(properties) in _STAMPS:
            return Scalar("stamp")
        fields = (
            (require_encodable_text(name), self.make_type_of_value(inner, depth + 1))
            for name, inner in properties.items()
        )
        return RecordType(
            str(schema.get("title", "object")),
            tuple((name, kind) for name, kind in fields if kind is not None),
        )

    def _follow_schema_reference(self, schema: Any) -> dict[str, Any]:
        for _ in range(LIMITS.json_depth):
            if not isinstance(schema, dict):
                return {}
            reference = schema.get("$ref")
            if not isinstance(reference, str) or not reference.startswith("#/"):
                return schema
            schema = self._root
            for step in reference.removeprefix("#/").split("/"):
                if not isinstance(schema, dict) or step not in schema:
                    raise BrokenBytesError(f"it refers to a missing definition: {reference}")
                schema = schema[step]
        raise BrokenBytesError("its references form a loop")


def find_sole_type_of_schema(schema: dict[str, Any]) -> str | None:
    """The single type that a schema allows besides null; None if there are several."""
    named = schema.get("type", "object" if "properties" in schema else [])
    allowed = named if isinstance(named, list) else [named]
    if not all(isinstance(kind, str) for kind in allowed):
        raise BrokenBytesError("a type in its JSON schema is not a string")
    kinds = {str(kind) for kind in allowed} - ({"null"} if isinstance(named, list) else set())
    return kinds.pop() if len(kinds) == 1 else None


def require_encodable_text(value: Any) -> str:
    """Return the value as text, which UTF-8 must encode: JSON allows unpaired surrogates."""
    text = str(value)
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise BrokenBytesError(error) from error
    return text


def _decode_json_message(data: bytes) -> Any:
    message = _parse_json_schema(data)
    if not isinstance(message, dict):
        raise BrokenBytesError("the message is not a JSON object")
    return message


def _get_message_member(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, dict) else None


def _refuse_value_that_is_no_list(values: Any) -> Sequence[Any]:
    if not isinstance(values, list):
        raise BrokenBytesError(f"a list is expected, not {_JSON_NAMES[type(values).__name__]}")
    return values


def _convert_value_to_type(value: Any, field_type: str) -> Any:
    if field_type == "string":
        return require_encodable_text(value)
    try:
        number = CONVERT.get(field_type, int)(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise BrokenBytesError(error) from error
    return require_number_fits_int64(number) if field_type == "int64" else number


def _convert_stamp_dict_to_ns(stamp: Any) -> int:
    if not isinstance(stamp, dict) or "sec" not in stamp:
        raise BrokenBytesError("a time is expected: an object with sec and nsec")
    nanoseconds = stamp.get("nsec", stamp.get("nanosec", 0))
    return require_number_fits_int64(
        _convert_value_to_type(stamp["sec"], "int64") * 10**9
        + _convert_value_to_type(nanoseconds, "int64")
    )


JSON: Final = DecodingLibrary(
    "json",
    _get_message_member,
    _convert_stamp_dict_to_ns,
    _refuse_value_that_is_no_list,
    _convert_value_to_type,
)
