"""Notice that a machine file is edited while it is in use as it was read."""

from pathlib import Path

from replay.machines.machine_file import machine_file_or_shipped


class MachineFileChange:
    """The text of a machine file, and whether another one has been told."""

    def __init__(self, path: Path) -> None:
        """Read it; one that is missing or no file is for those to refuse who load it."""
        self._path = machine_file_or_shipped(path)
        self._stamp = self._find_stamp()
        self._text = self._read()

    def is_new(self) -> bool:
        """Whether it has another text since the last question. One that is gone has none."""
        stamp = self._find_stamp()
        if stamp in (None, self._stamp):
            return False
        self._stamp, before = stamp, self._text
        self._text = self._read()
        return self._text != before

    def _find_stamp(self) -> tuple[int, int, int] | None:
        try:
            about = self._path.stat()
        except OSError:
            return None
        return about.st_mtime_ns, about.st_size, about.st_ino

    def _read(self) -> bytes:
        try:
            return self._path.read_bytes()
        except OSError:
            return b""
