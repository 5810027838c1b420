"""A file that grows by whole pieces: one that does not fit on the disc leaves it as it was."""

from io import FileIO
from pathlib import Path


class AppendedFile:
    """A file that is appended to, and there from its first piece on.

    Attributes:
        path: of the file.
        size: bytes of whole pieces.
    """

    def __init__(self, path: Path, size: int = 0) -> None:
        """Begin a file, or go on behind the first `size` bytes of one.

        Raises:
            OSError: it cannot be written to.
        """
        self.path, self.size = path, size
        self._file: FileIO | None = None
        if size:
            self._cut(self._open())

    def append(self, piece: bytes) -> None:
        """Append a piece.

        Raises:
            OSError: it does not fit on the disc.
        """
        rest = memoryview(piece)
        file = self._file or self._open()
        try:
            while rest:
                rest = rest[file.write(rest) :]
        except OSError:
            self._cut(file)
            raise
        self.size += len(piece)

    def rename(self, path: Path) -> None:
        """Give the file another name."""
        self.path = self.path.replace(path)

    def close(self) -> None:
        """Close the file as it is."""
        if self._file is not None:
            self._file.close()

    def _open(self) -> FileIO:
        self._file = self.path.open("r+b" if self.size else "wb", buffering=0)
        return self._file

    def _cut(self, file: FileIO) -> None:
        file.truncate(self.size)
        file.seek(self.size)
