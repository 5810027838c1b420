"""Growing memory for the rows of an integrated log; old rows can be dropped."""

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.plant import plant
from estimators.arrays import Floats


class RowBuffer:
    """Rows of a log, with the kind of stage of each."""

    def __init__(self) -> None:
        self._rows = np.empty((1024, plant.COLUMNS))
        self._size = 0
        self._kinds: list[int] = []
        self._counts: list[int] = []

    @property
    def rows(self) -> Floats:
        """(n, 16) all rows, sharing the growing memory."""
        return self._rows[: self._size]

    @property
    def kind_of_each_row(self) -> NDArray[np.int8]:
        """(n,) the kind of stage of each row."""
        return np.repeat(np.array(self._kinds, np.int8), self._counts)

    def provide_free_rows(self, count: int) -> Floats:
        """(at least count, 16) free memory after the rows, to be filled and committed."""
        if self._size + count > len(self._rows):
            self.reserve_rows(self._size + 2 * count)
        return self._rows[self._size : self._size + count]

    def reserve_rows(self, count: int) -> None:
        """Reserve memory for more rows; untouched memory is free."""
        grown = np.empty((self._size + count, plant.COLUMNS))
        grown[: self._size] = self.rows
        self._rows = grown

    def drop_rows_before(self, before_s: float) -> float:
        """Drop rows before a time except the last, and return the heading change in them.

        At least two rows are kept. Arrays handed out before keep their memory.
        """
        time_s = self.rows[:, plant.TIME]
        first = int(np.searchsorted(time_s, before_s, side="right")) - 1
        first = max(min(first, self._size - 2), 0)
        gone = self.rows[: first + 1]
        rate = gone[:, plant.YAW_RATE]
        turned = np.diff(gone[:, plant.TIME]) * (rate[1:] + rate[:-1]) / 2.0
        ends = np.cumsum(self._counts)
        stage = int(np.searchsorted(ends, first, side="right"))
        if first:
            self._rows = self.rows[first:].copy()
            self._size -= first
            self._kinds = self._kinds[stage:]
            self._counts = [int(ends[stage]) - first, *self._counts[stage + 1 :]]
        return float(turned.sum())

    def commit_rows(self, count: int, kind: int) -> None:
        """Commit filled rows, all of one kind of stage."""
        self._size += count
        self._kinds.append(kind)
        self._counts.append(count)
