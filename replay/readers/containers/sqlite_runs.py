"""Read pages of a file, neighbours at once."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from replay.readers.containers.file_bytes import FileBytes

#: Between pages that are wanted, so much is read with them: less than another read costs.
_MOST_BETWEEN: Final = 65_536


class Runs(NamedTuple):
    """Stretches of pages, (runs,) each: the first page of each, how many, and where they go."""

    first: NDArray[np.int64]
    pages: NDArray[np.int64]
    begin: NDArray[np.int64]


def lay_out(
    pages: NDArray[np.uint32], page_bytes: int, room: int
) -> tuple[Runs, NDArray[np.int64]]:
    """Stretches that hold `pages`, or as many of them as there is room for, at least one.

    Returns:
        The stretches, and (n,) where each of the first n pages will begin.
    """
    numbers = pages[: max(1, room // page_bytes)].astype(np.int64)
    step = np.diff(numbers)
    apart = (step < 1) | ((step - 1) * page_bytes > _MOST_BETWEEN)
    slot = np.concatenate([[0], np.cumsum(np.where(apart, 1, step))])
    count = int(np.searchsorted(slot, room // page_bytes))
    numbers, slot = numbers[:count], slot[:count]
    starts = np.concatenate([[0], np.flatnonzero(apart[: count - 1]) + 1])
    ends = np.concatenate([starts[1:], [count]]) - 1
    runs = Runs(numbers[starts], numbers[ends] - numbers[starts] + 1, slot[starts] * page_bytes)
    return runs, slot * page_bytes


def read_runs(file: FileBytes, runs: Runs, page_bytes: int, target: NDArray[np.uint8]) -> bool:
    """Read stretches to where they go in `target`; whether the file has all of them."""
    for first, pages, begin in zip(*(each.tolist() for each in runs), strict=True):
        part = target[begin : begin + pages * page_bytes]
        if file.read_into((first - 1) * page_bytes, part) < part.size:
            return False
    return True
