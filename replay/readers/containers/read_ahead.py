"""Unpack blocks ahead of who reads them, in other threads and in bounded memory."""

import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.readers.containers.block import LARGEST_BYTES, Block, DamagedBlockError, unpack
from replay.readers.containers.file_bytes import FileBytes
from replay.readers.containers.records import Grammar, Rows, Slab

#: Blocks are unpacked side by side up to this size, since who reads them pays by the slab.
SLAB_BYTES: Final = 8 * 2**20
_WORKERS: Final = min(4, os.cpu_count() or 1)
#: Slabs that wait; each block larger than a slab has one of its own, and then fewer wait.
_MOST_WAITING_BYTES: Final = (_WORKERS + 1) * SLAB_BYTES


def read_slabs(file: FileBytes, blocks: Iterable[Block], grammar: Grammar) -> Iterator[Slab]:
    """Unpack and scan blocks in their order.

    A slab's memory is used again as soon as the next slab is asked for.
    """
    free: list[NDArray[np.uint8]] = []
    waiting: deque[tuple[Future[Slab], int]] = deque()
    pool = ThreadPoolExecutor(_WORKERS, thread_name_prefix="payscope-unpack")
    try:
        for group in _groups(blocks):
            size = sum(_room(block) for block in group)
            while waiting and sum(each for _, each in waiting) + size > _MOST_WAITING_BYTES:
                yield from _next(waiting, free)
            recycled = free.pop() if free and size <= SLAB_BYTES else None
            waiting.append((pool.submit(_load, file, group, grammar, recycled), size))
        while waiting:
            yield from _next(waiting, free)
    finally:
        pool.shutdown(cancel_futures=True)


def _next(
    waiting: deque[tuple[Future[Slab], int]], free: list[NDArray[np.uint8]]
) -> Iterator[Slab]:
    slab = waiting.popleft()[0].result()
    yield slab
    if slab.data.size == SLAB_BYTES:
        free.append(slab.data)


def _room(block: Block) -> int:
    # a block that nobody believes takes no room; unpacking it says why
    return block.room if block.room <= LARGEST_BYTES else 0


def _groups(blocks: Iterable[Block]) -> Iterator[list[Block]]:
    group: list[Block] = []
    size = 0
    for block in blocks:
        if group and size + _room(block) > SLAB_BYTES:
            yield group
            group, size = [], 0
        group.append(block)
        size += _room(block)
    if group:
        yield group


def _load(
    file: FileBytes, blocks: list[Block], grammar: Grammar, recycled: NDArray[np.uint8] | None
) -> Slab:
    """What a worker does."""
    damaged: list[tuple[Block, str]] = []
    parts: list[tuple[Block, int, int, int]] = []
    try:
        size = max(SLAB_BYTES, sum(map(_room, blocks)))
        buffer = np.empty(size, np.uint8) if recycled is None else recycled
        rows = Rows(grammar, buffer, sum(sum(block.counts.values()) for block in blocks))
    except MemoryError:
        nothing = np.empty(0, np.uint8)
        lost = tuple((block, "not enough memory") for block in blocks)
        return Slab(nothing, Rows(grammar, nothing, 0).found, (), lost)
    at = 0
    for block in blocks:
        try:
            size = unpack(block, file, buffer[at : at + block.room])
            part = (block, *rows.scan(at, at + size))
        except DamagedBlockError as error:
            damaged.append((block, str(error)))
        except (OSError, MemoryError) as error:
            damaged.append((block, str(error) or "not enough memory"))
        else:
            parts.append(part)
            at += size
    return Slab(buffer, rows.found, tuple(parts), tuple(damaged))
