"""The write-ahead log beside a SQLite database: what of it no commit closes."""

from pathlib import Path
from struct import Struct
from typing import Final

#: magic, format, page size, number of checkpoints, two salts, two checksums
_HEADER: Final = Struct(">8I")
#: page, pages of the database after a commit and 0 before, two salts, two checksums
_FRAME: Final = Struct(">6I")
_MAGICS: Final = (0x377F0682, 0x377F0683)


def unclosed_bytes(path: Path) -> int:
    """How many bytes of a `-wal` file are of a transaction that was never ended.

    SQLite passes over them in silence: to it they never happened. To a recorder that crashed they
    are messages. Frames with other salts are leftovers of before the last checkpoint.

    Args:
        path: the `-wal` file.

    Returns:
        The bytes behind its last commit, a torn frame included.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER.size)
        if len(head) < _HEADER.size:
            return len(head)
        magic, _, page, _, *salts, _, _ = _HEADER.unpack(head)
        if magic not in _MAGICS:
            return 0
        size = file.seek(0, 2)
        at = closed = _HEADER.size
        while at < size:
            file.seek(at)
            frame = file.read(_FRAME.size)
            if len(frame) < _FRAME.size:
                return size - closed
            _, commit, *found, _, _ = _FRAME.unpack(frame)
            if found != salts:
                return at - closed
            at += _FRAME.size + page
            if commit and at <= size:
                closed = at
        return size - closed
