"""How long a fleet's run still takes, with what is not known of it."""

import math
from typing import Final

#: Bytes that take as long as whatever a recording takes besides its size.
_BASE_BYTES: Final = 2_000_000
#: Before so many are done, nothing is said.
_FEWEST: Final = 5
#: Of an interval of 95 %.
_K: Final = 2.0


class TimeLeft:
    """An estimate by the recordings that are done: their seconds by size, and how these scatter."""

    def __init__(self, sizes_bytes: list[int]) -> None:
        self._left = sum(map(_weight, sizes_bytes))
        self._squares = sum(_weight(size) ** 2 for size in sizes_bytes)
        self._done: list[tuple[float, float]] = []

    def done(self, size_bytes: int, seconds: float | None) -> None:
        """A recording is done, after so many seconds on its node; None where it was there."""
        weight = _weight(size_bytes)
        self._left -= weight
        self._squares -= weight**2
        if seconds is not None:
            self._done.append((weight, seconds))

    def interval_s(self, slots: int) -> tuple[float, float] | None:
        """From and to, in s, for so many at once; None while nothing can be said.

        Seconds are a rate times a weight, with a scatter that grows with the weight.
        """
        if len(self._done) < _FEWEST:
            return None
        weight = sum(w for w, _ in self._done)
        rate = sum(s for _, s in self._done) / weight
        apart = sum((s / w - rate) ** 2 for w, s in self._done) / (len(self._done) - 1)
        expected = rate * self._left
        # of the rate, and of each that is left
        u = math.sqrt(apart * (self._left**2 / len(self._done) + max(self._squares, 0.0)))
        low, high = max(expected - _K * u, 0.0), expected + _K * u
        return low / slots, high / slots


def _weight(size_bytes: int) -> float:
    return float(size_bytes + _BASE_BYTES)


def spoken(interval_s: tuple[float, float] | None) -> str:
    """The interval in words, in the unit that suits it."""
    if interval_s is None:
        return ""
    low, high = interval_s
    for unit, seconds in (("h", 3600.0), ("min", 60.0)):
        if high >= 2 * seconds:
            return f"{low / seconds:.1f} to {high / seconds:.1f} {unit} left"
    return f"{low:.0f} to {high:.0f} s left"
