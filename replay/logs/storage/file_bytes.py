"""Thread-safe reading of a file by position."""

import zlib
from pathlib import Path
from threading import Lock
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Bytes that are read at once.
_STEP: Final = 2**20


class FileBytes:
    """A file that threads read by position.

    It is not memory-mapped: mapped files count as memory in use, and one that shrinks while it is
    read would crash the process.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = path.open("rb", buffering=0)
        self._lock = Lock()
        self.size = self._file.seek(0, 2)

    def read_bytes(self, offset: int, max_bytes: int) -> bytes:
        """Read at most `max_bytes` bytes; fewer at the end of the file, none beyond it."""
        return self.read_byte_array(offset, max_bytes).tobytes()

    def read_byte_array(self, offset: int, max_bytes: int) -> NDArray[np.uint8]:
        """Read bytes as an array (n,), without an additional copy."""
        data = np.empty(max(0, min(max_bytes, self.size - offset)), np.uint8)
        return data[: self.read_into(offset, data)]

    def read_into(self, offset: int, target: NDArray[np.uint8]) -> int:
        """Fill `target` with the bytes from `offset` on, and return their number."""
        view, done = target.data, 0
        if not 0 <= offset <= self.size:
            return 0
        with self._lock:
            self._file.seek(offset)
            while done < len(view):
                count = self._file.readinto(view[done:])
                if not count:
                    break
                done += count
        return done

    def update_size(self) -> int:
        """Update and return the size of a growing file."""
        with self._lock:
            self.size = self._file.seek(0, 2)
        return self.size

    def compute_crc32_before_offset(self, end_offset: int) -> int:
        """Compute the CRC-32 of all bytes before an offset."""
        crc = 0
        for at in range(0, end_offset, _STEP):
            crc = zlib.crc32(self.read_bytes(at, min(_STEP, end_offset - at)), crc)
        return crc

    def close(self) -> None:
        """Release the file."""
        self._file.close()


class ReadBuffer:
    """Buffer with a part of a file, for many small reads; other reads go to the file."""

    def __init__(self, file: FileBytes, offset: int, count: int) -> None:
        self.size = file.size
        self._file = file
        self._offset = offset
        self._data = file.read_bytes(offset, count)

    def read_bytes(self, offset: int, count: int) -> bytes:
        """See `FileBytes.read_bytes`."""
        at = offset - self._offset
        if 0 <= at <= len(self._data) - count:
            return self._data[at : at + count]
        return self._file.read_bytes(offset, count)
