"""Go through a SQLite table page by page."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.readers.containers.file_bytes import FileBytes
from replay.readers.containers.sqlite_cells import ID, ID_BEFORE, LEAF_AT, ROW, scan_leaves
from replay.readers.containers.sqlite_chains import Chains
from replay.readers.containers.sqlite_leaves import leaf_pages
from replay.readers.containers.sqlite_pages import Layout, Wanted
from replay.readers.containers.sqlite_rows import LEAST_ID, Rows
from replay.readers.containers.sqlite_runs import lay_out, read_runs

#: Read at once: leaves, and behind them messages that are joined from overflow pages.
_LEAF_BYTES: Final = 4 * 2**20
_JOINED_BYTES: Final = 4 * 2**20
_MOST_ROWS: Final = 65_536
_MOST_SPILLED: Final = 8192
_FIRST_LEAVES: Final = 64


@dataclass(slots=True)
class _Memory:
    data: NDArray[np.uint8] = field(
        default_factory=lambda: np.empty(_LEAF_BYTES + _JOINED_BYTES, np.uint8)
    )
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty((5, _MOST_ROWS), np.int64))


class PageWalk:
    """Rows of a table in the order of their ids. It ends where pages are damaged or unusual."""

    def __init__(self, file: FileBytes, layout: Layout, wanted: Wanted) -> None:
        self._file = file
        self._layout = layout
        self._wanted = wanted
        self._chains = Chains(file, layout)
        self._spills = np.empty((5, _MOST_SPILLED), np.int64)
        self._place = np.array([0, 0, LEAST_ID])
        #: once it ended: the id behind which rows are left to SQLite, None if none are
        self.left_after: int | None = LEAST_ID

    def __iter__(self) -> Iterator[Rows]:
        try:
            leaves = leaf_pages(self._file, self._layout)
            if leaves is not None:
                yield from self._steps(leaves)
        except (OSError, MemoryError):
            return  # SQLite says what is the matter, or has another way

    def _steps(self, leaves: NDArray[np.uint32]) -> Iterator[Rows]:
        memories = (_Memory(), _Memory())
        at, step, reach = 0, 0, _FIRST_LEAVES
        while at < leaves.size:
            rows, left_after = self._read(leaves[at : at + reach], memories[step % 2])
            self.left_after = int(self._place[ID_BEFORE]) if left_after is None else left_after
            yield rows
            if left_after is not None:
                return
            # large messages fill a step from few leaves, and others would be read for nothing
            done = int(self._place[LEAF_AT])
            reach = 2 * (done + 1)
            at += done
            step += 1
        self.left_after = None

    def _read(self, leaves: NDArray[np.uint32], memory: _Memory) -> tuple[Rows, int | None]:
        """Rows from some leaves on; the id behind which pages are damaged, if they are."""
        size = self._layout.page_bytes
        runs, slots = lay_out(leaves, size, _LEAF_BYTES)
        if not read_runs(self._file, runs, size, memory.data):
            raise OSError("the file became shorter")
        tail = int(runs.begin[-1] + runs.pages[-1] * size)
        self._place[LEAF_AT] = 0
        found, spilled, joined_bytes, is_whole = scan_leaves(
            memory.data,
            slots,
            self._layout,
            self._wanted,
            tail,
            _JOINED_BYTES,
            self._place,
            memory.rows,
            self._spills,
        )
        data = memory.data
        if tail + joined_bytes > data.size:
            data = np.empty(tail + joined_bytes, np.uint8)
            data[:tail] = memory.data[:tail]
        joined = self._chains.join(data, runs, memory.rows, self._spills, spilled)
        if joined < spilled:
            found = int(self._spills[ROW, joined])
            return Rows(data, memory.rows[:, :found]), int(memory.rows[ID, found]) - 1
        left_after = None if is_whole else int(self._place[ID_BEFORE])
        return Rows(data, memory.rows[:, :found]), left_after
