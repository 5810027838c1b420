"""The unit of times that are numbers, told by their range and spacing."""

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from replay.logs.tables.epochs import epoch_of, from_1904
from replay.logs.tables.times import NS_PER_UNIT, TimeError, nanoseconds

#: A log of a machine has from one row in two seconds to 2,500 a second, in s from row to row:
#: slower shows no start, and faster is a scope's, which states its unit.
_STEPS_S: Final = (0.4e-3, 2.0)
#: It lasts so long at least, in s: a shorter one holds no start and stop.
_SHORTEST_S: Final = 1.0
#: Seconds since 1970 of a log: from 2000 to 2100.
_EPOCH_S: Final = (946_684_800.0, 4_102_444_800.0)
_ROUND: Final = 1e-6

Floats = NDArray[np.float64]


def recognised_times(cells: pl.Series) -> tuple[pl.Series, tuple[str, ...]]:
    """Log times of numbers without a unit.

    Args:
        cells: (rows,), text or numbers.

    Returns:
        Stamps in ns, null where there is none; and what was recognised.

    Raises:
        TimeError: several units are possible, or none.
    """
    stripped = cells.str.strip_chars() if cells.dtype == pl.String else cells
    numbers = stripped.cast(pl.Float64, strict=False)
    finite = numbers.filter(numbers.is_finite().fill_null(value=False)).to_numpy()
    if not finite.size:
        return nanoseconds(cells, "s"), ()
    x = np.sort(finite)
    steps = np.diff(x)
    steps = steps[steps > 0]
    if not steps.size:
        raise TimeError("it holds one and the same number: name another column")
    step, span = float(np.median(steps)), float(x[-1] - x[0])
    if epoch := epoch_of(float(x[0]), float(x[-1]), step, _STEPS_S):
        integers = stripped.cast(pl.Int64, strict=False)
        exact = not stripped.dtype.is_float() and integers.count() == numbers.count()
        return epoch.since_1970_ns(integers if exact else numbers), (f"its times are {epoch.name}",)
    if _is_clock(finite, step):
        hours, rest = numbers // 10_000, numbers % 10_000
        seconds = hours * 3600 + (rest // 100) * 60 + rest % 100
        return nanoseconds(seconds, "s"), ("its times are read as hhmmss.s",)
    unit = _unit(x, step, span)
    stamps, note = from_1904(nanoseconds(cells, unit))
    taken = f"its times are taken in {unit}, by their spacing"
    return stamps, (taken, note) if note else (taken,)


def _unit(x: Floats, step: float, span: float) -> str:
    """The one unit that is possible."""
    possible = [
        unit
        for unit, ns in NS_PER_UNIT.items()
        if _STEPS_S[0] <= step * ns / 1e9 <= _STEPS_S[1]
        and (span * ns / 1e9 >= _SHORTEST_S or x.size < 3)
    ]
    if len(possible) == 1:
        return possible[0]
    since_1970 = [
        unit
        for unit in possible
        if _EPOCH_S[0] <= x[0] * NS_PER_UNIT[unit] / 1e9
        and x[-1] * NS_PER_UNIT[unit] / 1e9 <= _EPOCH_S[1]
    ]
    if len(since_1970) == 1:
        return since_1970[0]
    said = " or ".join(possible) if possible else "s, ms, us or ns"
    raise TimeError(
        f"its steps of {step:g} may be {said}: set [log] time_unit, or, where it counts rows, "
        "[log] rate_hz = the rows in a second,"
    )


def _is_clock(x: Floats, step: float) -> bool:
    """Whether numbers are hhmmss.s: none beyond 59 s or min, and a jump of 40 at each minute."""
    if x.min() < 0 or x.max() >= 240_000 or step > _STEPS_S[1]:
        return False
    if (x % 100 >= 60).any() or (x // 100 % 100 >= 60).any():
        return False
    jumps = np.abs(np.diff(x))
    return bool((np.abs(jumps - 40.0 - step) < step + _ROUND * 40).any()) and x.max() - x.min() > 40
