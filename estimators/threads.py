"""Processing of windows in chunks on several cores, with results independent of their number."""

import ctypes
import os
import sys
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Final, TypeVar

from numba.core import config

T = TypeVar("T")
R = TypeVar("R")

#: Windows in a chunk: few enough for the cache, and enough that Python's overhead is negligible.
CHUNK: Final = 8192
#: Smallest number of chunks for which threads are started.
_WORTH_THREADS: Final = 8

#: Parameters of glibc's `mallopt`, by number.
_TRIM_THRESHOLD: Final = -1
_MMAP_THRESHOLD: Final = -3
#: Largest block in bytes that is taken from the heap: of 8 h, columns of a fit have up to half a
#: gigabyte. Some versions of glibc allow no more than the second.
_LARGEST_HEAP_BLOCKS: Final = (1 << 30, 1 << 25)
#: Free bytes at the top of the heap that are kept.
_MOST_KEPT: Final = 1 << 30


def keep_freed_memory_in_glibc() -> None:
    """Make glibc keep freed memory, if there is a glibc and the environment does not configure it.

    By default it returns blocks above a threshold to the system, so that the arrays of each chunk
    would be paged in again, which costs more than the work. Heaps of threads other than the first
    are limited to 64 MiB; larger blocks are still mapped there.
    """
    is_set = any(name.startswith(("MALLOC_", "GLIBC_TUNABLES")) for name in os.environ)
    if sys.platform != "linux" or is_set:
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    # without the first threshold the second would stop glibc from raising its own
    if mallopt and any(mallopt(_MMAP_THRESHOLD, size) for size in _LARGEST_HEAP_BLOCKS):
        mallopt(_TRIM_THRESHOLD, _MOST_KEPT)


keep_freed_memory_in_glibc()


def return_freed_memory_to_os() -> None:
    """Return memory that glibc keeps to the system, after a stage that needed a lot of it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim:
        trim(0)


def run_in_chunks(process_slice: Callable[[slice], None], rows: int) -> None:
    """Call `process_slice` for slices that cover `rows`, in any order; each writes its own rows.

    The loops release the interpreter's lock. NUMBA_NUM_THREADS limits the cores, as for numba.
    """
    chunks = [slice(start, min(start + CHUNK, rows)) for start in range(0, rows, CHUNK)]
    map_in_threads(process_slice, chunks, _WORTH_THREADS)


def map_in_threads(
    process_item: Callable[[T], R], items: Sequence[T], items_per_thread: int = 1
) -> list[R]:
    """Call `process_item` with each item, and return the results in order.

    Args:
        process_item: function that mostly runs loops which release the interpreter's lock.
        items: arguments of the calls.
        items_per_thread: minimum number of items for each thread.
    """
    cores: int = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue] made at run time
    threads = min(cores, len(items) // items_per_thread)
    if threads < 2:
        return [process_item(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(process_item, items))


@contextmanager
def limit_blas_to_one_thread() -> Generator[None]:
    """Limit BLAS to one thread, as a context or a decorator.

    BLAS splits sums over long vectors among its threads, so that their last bits depend on the
    number of threads. Long vectors are summed by this package's own loops, so nothing becomes
    slower. The limit applies to the whole process and ends with the first context that set it.
    """
    from threadpoolctl import threadpool_limits  # sets an environment variable when imported

    with threadpool_limits(limits=1, user_api="blas"):
        yield
