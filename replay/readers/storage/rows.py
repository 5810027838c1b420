"""Messages as containers find them: rows of a table of numbers, grouped by key, made ahead."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

#: Columns of a row. Of a record that is no message, `KEY` is -1 - opcode, and `OFFSET` and
#: `LENGTH` tell where all of it lies.
KEY, TIME, OFFSET, LENGTH = range(4)


def group_by_key(keys: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Which of `keys` (n,) are which connection, in their order; negative ones are none."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    bounds = [*np.flatnonzero(np.diff(ordered)) + 1, ordered.size]
    begin = int(np.searchsorted(ordered, 0))
    for end in bounds:
        if end > begin:
            yield int(ordered[begin]), order[begin:end]
            begin = end


def prefetch(steps: Iterator[T]) -> Iterator[T]:
    """The same steps, the next of which is made in another thread while one is worked on."""
    with ThreadPoolExecutor(1, thread_name_prefix="payscope-ahead") as pool:
        following = pool.submit(next, steps, None)
        while (step := following.result()) is not None:
            following = pool.submit(next, steps, None)
            yield step
