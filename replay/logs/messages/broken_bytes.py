"""Damaged data: the content of a log violates its format.

Only the call of a library is guarded with `BROKEN_BYTES`, and the value that it returns is checked;
either raises `BrokenBytesError`, which alone is caught further up and reported as damage. An error
of our own code, whichever it is, reaches the user as what it is.
"""

import struct
from typing import Final

from estimators.errors import one_line

#: What the format libraries raise on bytes that are not what they should be, their own errors
#: aside (lz4 raises RuntimeError, bz2 OSError and EOFError, rosbags asserts).
BROKEN_BYTES: Final = (
    ArithmeticError,
    AssertionError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)


class BrokenBytesError(Exception):
    """Data cannot be used; one line with the reason."""

    def __init__(self, why: object) -> None:
        super().__init__(one_line(" ".join(str(why).split())))
