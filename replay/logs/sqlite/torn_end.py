"""What a SQLite database lost at its end: torn pages, and a write-ahead log never committed."""

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


def describe_tear(head: bytes, size: int) -> str | None:
    """Say what is wrong with the end of a database, by its first page; None where it is whole."""
    page = int.from_bytes(head[16:18], "big")
    page = 2**16 if page == 1 else page
    # the number of pages counts if what changed it last also changed the version behind it
    pages = int.from_bytes(head[28:32], "big") if head[24:28] == head[92:96] else 0
    if not page or not (size % page or pages * page > size):
        return None
    if pages and size > pages * page:
        return f"has {size - pages * page:,} bytes behind its last page, which are not read"
    unsure = ", and its last page is torn: what stood there may be altered" if size % page else ""
    return f"breaks off after byte {size:,} of {max(pages * page, size):,}{unsure}"
