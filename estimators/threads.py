"""Windows in chunks, on as many cores as there are where a chunk is worth a thread."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
from numba.core import config

#: Windows that are worked on together: their sums stay in the cache, and Python costs nothing.
CHUNK: Final = 8192
#: Fewer chunks than these are not worth starting threads for.
_WORTH_THREADS: Final = 8

# glibc gives freed memory back to the system beyond a threshold that grows with the largest block
# freed. Below it the arrays of every chunk would be paged in anew, which costs more than the work.
_UNTOUCHED = np.empty(3 * 2**20)
del _UNTOUCHED


def in_chunks(work: Callable[[slice], None], rows: int) -> None:
    """Call `work` with slices that cover `rows`; each writes its own rows, so order is no matter.

    The loops release the interpreter's lock. NUMBA_NUM_THREADS bounds the cores, as for numba.
    """
    chunks = [slice(begin, min(begin + CHUNK, rows)) for begin in range(0, rows, CHUNK)]
    cores: int = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue] made at run time
    threads = min(cores, len(chunks) // _WORTH_THREADS)
    if threads < 2:
        for chunk in chunks:
            work(chunk)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, chunks))
