"""Rows of messages: group them by connection, and prefetch batches of them."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

#: Columns of a row. For a record that is not a message, `KEY` is -1 - opcode, and `OFFSET` and
#: `LENGTH` are those of the whole record.
KEY, TIME, OFFSET, LENGTH = range(4)


def group_rows_by_connection(
    connection_of_row: NDArray[np.int64],
) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yield each nonnegative connection of `connection_of_row` (n,), and its row indices."""
    order = np.argsort(connection_of_row, kind="stable")
    ordered = connection_of_row[order]
    bounds = [*np.flatnonzero(np.diff(ordered)) + 1, ordered.size]
    start = int(np.searchsorted(ordered, 0))
    for end in bounds:
        if end > start:
            yield int(ordered[start]), order[start:end]
            start = end


def prefetch_items_in_thread(items: Iterator[T]) -> Iterator[T]:
    """Prefetch: yield the items while another thread produces the next one."""
    with ThreadPoolExecutor(1, thread_name_prefix="payscope-prefetch") as pool:
        following = pool.submit(next, items, None)
        while (item := following.result()) is not None:
            following = pool.submit(next, items, None)
            yield item
