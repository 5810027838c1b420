"""Clocks that count from another day than 1970, told by how large their numbers are."""

from dataclasses import dataclass
from typing import Final

import polars as pl

#: Nanoseconds of a day.
_DAY_NS: Final = 86_400 * 10**9
#: Seconds since 1970 of a log: from 2000 to 2041. No log is of a later day than today, and with
#: this end no number is a day of two of these clocks.
_LOG_S: Final = (946_684_800, 2_240_611_200)


@dataclass(frozen=True, slots=True)
class Epoch:
    """A clock: how it is called, ns in its unit, and what it shows at the beginning of 1970."""

    name: str
    unit_ns: int
    at_1970: float

    def has(self, low: float, high: float) -> bool:
        """Whether numbers from `low` to `high` are days of a log by this clock."""
        begin, end = (s * 1e9 / self.unit_ns + self.at_1970 for s in _LOG_S)
        return begin <= low and high < end

    def since_1970_ns(self, numbers: pl.Series) -> pl.Series:
        """Its numbers as Int64 ns since 1970."""
        if numbers.dtype.is_integer() and float(self.at_1970).is_integer():
            return (numbers.cast(pl.Int64) - int(self.at_1970)) * self.unit_ns
        since = numbers.cast(pl.Float64) - self.at_1970
        whole = since.floor()
        fraction = ((since - whole) * self.unit_ns).round()
        return whole.cast(pl.Int64, strict=False) * self.unit_ns + fraction.cast(
            pl.Int64, strict=False
        )


SPREADSHEET: Final = Epoch("days of a spreadsheet", _DAY_NS, 25_569)
_LABVIEW: Final = Epoch("seconds since 1904, as LabVIEW counts", 10**9, 2_082_844_800)
#: Each in a unit that none of `[log] time_unit` is.
_OTHERS: Final = (
    SPREADSHEET,
    Epoch("days of MATLAB's datenum", _DAY_NS, 719_529),
    Epoch("Julian days", _DAY_NS, 2_440_587.5),
    Epoch("modified Julian days", _DAY_NS, 40_587),
    Epoch("ticks of 100 ns since the year 1, as .NET counts", 100, 621_355_968_000_000_000),
    Epoch("ticks of 100 ns since 1601, as Windows counts", 100, 116_444_736_000_000_000),
)


def epoch_of(low: float, high: float, step: float, steps_s: tuple[float, float]) -> Epoch | None:
    """The clock of which numbers are days of a log; None where it is none of these.

    Args:
        low: the least number.
        high: the largest one.
        step: from row to row.
        steps_s: least and largest step of a log, in s.
    """
    for epoch in _OTHERS:
        if epoch.has(low, high) and steps_s[0] <= step * epoch.unit_ns / 1e9 <= steps_s[1]:
            return epoch
    return None


def from_1904(stamps: pl.Series) -> tuple[pl.Series, str | None]:
    """Stamps in ns since 1970 also where LabVIEW counted them from 1904, which is then said."""
    low, high = stamps.min(), stamps.max()
    if not isinstance(low, int) or not isinstance(high, int):
        return stamps, None
    if not _LABVIEW.has(low / 1e9, high / 1e9):
        return stamps, None
    return stamps - int(_LABVIEW.at_1970) * _LABVIEW.unit_ns, f"its times are {_LABVIEW.name}"
