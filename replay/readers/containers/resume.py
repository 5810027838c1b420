"""Find where records go on behind damage."""

from typing import Final

import numpy as np

from replay.readers.containers.file_bytes import FileBytes
from replay.readers.containers.records import Find

#: The first look is short, since damage mostly is: many small faults must not cost a large read
#: each. It is long enough for a few records, and so is what two looks share.
_SHORTEST: Final = 16_384
_LONGEST: Final = 8 * 2**20


def resume(file: FileBytes, damaged: int, find: Find) -> int | None:
    """The offset behind `damaged` at which records go on; None where they do not."""
    at, size = damaged + 1, _SHORTEST
    while at < file.size:
        data = np.frombuffer(file.read(at, size), np.uint8)
        found = find(data, 0, data.size, file.size - at)
        if found >= 0:
            return at + found
        at += max(data.size - _SHORTEST // 2, _SHORTEST // 2)
        size = min(2 * size, _LONGEST)
    return None
