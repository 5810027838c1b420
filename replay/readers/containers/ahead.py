"""Work one step ahead of who takes the steps."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def ahead(steps: Iterator[T]) -> Iterator[T]:
    """The same steps, the next of which is made in another thread while one is worked on."""
    with ThreadPoolExecutor(1, thread_name_prefix="payscope-ahead") as pool:
        following = pool.submit(next, steps, None)
        while (step := following.result()) is not None:
            following = pool.submit(next, steps, None)
            yield step
