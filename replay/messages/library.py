"""Libraries that decode one message at a time, and how their messages are taken apart."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from rosbags.typesys.base import normalize_fieldname


def int64(value: int) -> int:
    """The same number.

    Raises:
        OverflowError: a column of 64-bit integers cannot hold it.
    """
    if not -(2**63) <= value < 2**63:
        raise OverflowError(f"{value} is no 64-bit integer")
    return value


@dataclass(frozen=True, slots=True)
class Library:
    """A library, by its name."""

    name: str
    #: a field of a message, by its name; None where the message does not have it
    get: Callable[[Any, str], Any]
    #: a time or duration in ns
    stamp_ns: Callable[[Any], int]


ROSBAGS: Final = Library(
    "rosbags",
    lambda message, name: getattr(message, normalize_fieldname(name)),
    lambda stamp: int(stamp.sec) * 10**9 + int(stamp.nanosec),
)
