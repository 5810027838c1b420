"""Libraries that decode single messages, and access to the fields of their messages.

All functions raise `BrokenBytesError` for a value that does not match the definition.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rosbags.typesys.base import normalize_fieldname

from replay.logs.messages.broken_bytes import BrokenBytesError


def require_number_fits_int64(value: int) -> int:
    """Return a number unchanged.

    Raises:
        BrokenBytesError: the number does not fit into 64 bits.
    """
    if not -(2**63) <= value < 2**63:
        raise BrokenBytesError(f"{value} is not a 64-bit integer")
    return value


def _return_unchanged(values: Any) -> Any:
    return values


@dataclass(frozen=True, slots=True)
class DecodingLibrary:
    """Library that decodes single messages: its name, and how fields of its messages are read."""

    name: str
    #: function that returns a field of a message by name; None if the message lacks it
    get: Callable[[Any, str], Any]
    #: function that converts a time or duration to ns
    stamp_ns: Callable[[Any], int]
    #: function that returns the elements of a list
    elements: Callable[[Any], Sequence[Any]] = _return_unchanged
    #: function that converts a value for a column of a kind
    convert: Callable[[Any, str], Any] = lambda value, kind: CONVERT.get(kind, int)(value)


#: Conversion of a value, by kind; values of other kinds are integers.
CONVERT: Final[dict[str, Callable[[Any], Any]]] = {
    "bool": bool,
    "string": str,
    "wstring": str,
    **dict.fromkeys(("float32", "float64", "float128"), float),
    # the octet of ROS 2 has this kind too, and rosbags reads it as a signed number
    "uint8": lambda value: int(value) & 0xFF,
}

ROSBAGS: Final = DecodingLibrary(
    "rosbags",
    lambda message, name: getattr(message, normalize_fieldname(name)),
    lambda stamp: int(stamp.sec) * 10**9 + int(stamp.nanosec),
)
