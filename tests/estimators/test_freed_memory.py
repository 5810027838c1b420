"""What a process tells its C library of freed memory."""

import ctypes
import os
import sys

import pytest

from estimators import threads

TRIM, KEPT = threads._TRIM_THRESHOLD, threads._MOST_KEPT
LARGE, SMALL = threads._LARGEST_HEAP_BLOCKS


class Library:
    """A C library that takes blocks of at most so many bytes from the heap."""

    def __init__(self, largest: int) -> None:
        self.largest = largest
        self.thresholds: dict[int, int] = {}

    def mallopt(self, parameter: int, value: int) -> int:
        if parameter == threads._MMAP_THRESHOLD and value > self.largest:
            return 0
        self.thresholds[parameter] = value
        return 1


@pytest.fixture(autouse=True)
def _linux(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in [name for name in os.environ if name.startswith(("MALLOC_", "GLIBC_"))]:
        monkeypatch.delenv(name)


@pytest.mark.parametrize(
    ("largest", "taken"), [(2 * LARGE, LARGE), (LARGE - 1, SMALL), (SMALL, SMALL)]
)
def test_blocks_come_from_the_heap_up_to_what_the_library_allows(
    largest: int, taken: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = Library(largest)
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    threads.keep_freed_memory_in_glibc()
    assert library.thresholds == {threads._MMAP_THRESHOLD: taken, TRIM: KEPT}


def test_without_a_threshold_of_blocks_nothing_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other one alone would make each block of 128 KiB and more a mapping of its own."""
    library = Library(0)
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    threads.keep_freed_memory_in_glibc()
    assert library.thresholds == {}


@pytest.mark.parametrize("name", ["MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES"])
def test_an_allocator_that_the_environment_sets_is_left_alone(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = Library(2 * LARGE)
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    monkeypatch.setenv(name, "1")
    threads.keep_freed_memory_in_glibc()
    assert library.thresholds == {}
