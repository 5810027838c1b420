"""Pipe that replaces a file which another library writes by name."""

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import BinaryIO, Final

from recordings.rrd.recording_limits import LIMITS

_DESCRIPTORS: Final = Path("/dev/fd")


class PipedFile:
    """Pipe whose content is copied to a file; after an error, the rest is discarded.

    Attributes:
        name: name that the library opens for writing, once.
        fault: error that stopped writing; None without one.
    """

    def __init__(self, path: Path) -> None:
        self.fault: OSError | None = None
        self.name = str(path)
        self._path = path
        self._write = -1
        self._thread: Thread | None = None
        if _DESCRIPTORS.is_dir():  # elsewhere the library writes the file itself
            # opened here, since a late thread would create the file again after it was abandoned
            file = path.open("wb", buffering=0)
            read, self._write = os.pipe()
            self.name = str(_DESCRIPTORS / str(self._write))
            self._thread = Thread(target=self._copy_pipe_to_file, args=(read, file), daemon=True)
            self._thread.start()

    @property
    def written_bytes(self) -> int:
        """Bytes written to the file so far."""
        return self._path.stat().st_size if self._path.exists() else 0

    def close_writing_end(self) -> None:
        """Close our writing end once the library has its own; the file ends when that is closed."""
        if self._write >= 0:
            os.close(self._write)
            self._write = -1

    def wait_until_file_is_complete(self) -> None:
        """Wait until everything is written to the file.

        Raises:
            OSError: part of it could not be written.
        """
        self.close_writing_end()
        if self._thread is not None:
            self._thread.join()
        self.raise_write_error()

    def raise_write_error(self) -> None:
        """Raise the error of the file, if there is one.

        Raises:
            OSError: the file cannot be written.
        """
        if self.fault is not None:
            raise self.fault

    def _copy_pipe_to_file(self, pipe_descriptor: int, file: BinaryIO) -> None:
        """Copy the pipe to the file; after an error, read on without writing."""
        # the library may wait forever if it must stop within its queue, so the pipe never blocks
        with open(pipe_descriptor, "rb", buffering=0) as source:
            try:
                with file:
                    while block := source.read(LIMITS.copied_block_bytes):
                        rest = memoryview(block)
                        while rest:
                            rest = rest[file.write(rest) :]
            except OSError as error:
                self.fault = error
                while source.read(LIMITS.copied_block_bytes):
                    pass


@contextmanager
def open_piped_file(path: Path) -> Generator[PipedFile]:
    """Context that writes `path` through a pipe; it is complete at the end.

    Raises:
        OSError: it cannot be written, or the disk is full.
    """
    piped = PipedFile(path)
    try:
        yield piped
    finally:
        piped.close_writing_end()
    piped.wait_until_file_is_complete()
