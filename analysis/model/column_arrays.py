"""Columns of a frame as arrays, for stages that look at a few rows at a time."""

from typing import Any

from numpy.typing import NDArray


class ColumnArrays(dict[str, NDArray[Any]]):
    """Columns of a frame as arrays (rows,), with NaN for null.

    Of a few rows, as while following a log, a frame costs more than what is computed from it.
    """

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return [*self]

    @property
    def height(self) -> int:
        """Number of rows."""
        return next((column.size for column in self.values()), 0)
