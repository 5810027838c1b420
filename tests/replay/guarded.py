"""Memory between two pages that nobody may touch: who reads past its ends ends the process."""

import ctypes
import mmap
from typing import Final

import numpy as np
from numpy.typing import NDArray

_NOTHING_ALLOWED: Final = 0  # PROT_NONE


class Guarded:
    """Room for bytes right before, or right behind, such a page."""

    def __init__(self, room: int) -> None:
        page = mmap.PAGESIZE
        size = -(-room // page) * page
        self._map = mmap.mmap(-1, size + 2 * page)
        begin = ctypes.addressof(ctypes.c_char.from_buffer(self._map))
        protect = ctypes.CDLL(None, use_errno=True).mprotect
        for guard in (begin, begin + page + size):
            if protect(ctypes.c_void_p(guard), ctypes.c_size_t(page), _NOTHING_ALLOWED):
                raise OSError(ctypes.get_errno(), "no page can be guarded")
        self._room = np.frombuffer(self._map, np.uint8)[page : page + size]

    def at_end(self, content: bytes) -> NDArray[np.uint8]:
        """The bytes, whose last is the last that may be read; they last until the next call."""
        return self._filled(self._room[self._room.size - len(content) :], content)

    def at_begin(self, content: bytes) -> NDArray[np.uint8]:
        """The bytes, whose first is the first that may be read."""
        return self._filled(self._room[: len(content)], content)

    @staticmethod
    def _filled(place: NDArray[np.uint8], content: bytes) -> NDArray[np.uint8]:
        place[:] = np.frombuffer(content, np.uint8)
        return place
