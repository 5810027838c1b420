"""Between the rows of an integrated log: straight lines, and how fast they rise."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.plant import plant
from analysis.simulation.scenario.waveforms import Floats
from estimators.compiled import inlined, uncounted

#: What changes how fast: the force on the ground, the yaw rate, the acceleration, the mass.
FORCE_RATE, TURN, JERK, FILLING = range(4)
#: Their number.
SLOPES: Final = 4
#: Rows that are passed one by one before the rest is searched.
_NEAR: Final = 16


@inlined
def _row_before(rows: Floats, time_s: float, known: int) -> int:
    """The last row at or before a time, but neither before the first nor the last of all."""
    most = rows.shape[0] - 2
    least = 0
    if rows[known, plant.TIME] <= time_s:
        least = known
        for _ in range(_NEAR):
            if least >= most or rows[least + 1, plant.TIME] > time_s:
                return least
            least += 1
    while least < most:
        middle = (least + most + 1) // 2
        if rows[middle, plant.TIME] <= time_s:
            least = middle
        else:
            most = middle - 1
    return least


@inlined
def _value(row: Floats, which: int) -> float:
    if which == FORCE_RATE:
        return row[plant.GROUND] - row[plant.BRAKED]
    if which == FILLING:
        return row[plant.MASS]
    return row[plant.YAW_RATE if which == TURN else plant.ACCELERATION]


@inlined
def _slope(rows: Floats, at: int, which: int) -> float:
    """How fast a value changes at a row: on both sides of it, without what changes at once."""
    total, known = 0.0, 0.0
    for first in (at - 1, at):
        if first >= 0 and first + 1 < rows.shape[0]:
            span = rows[first + 1, plant.TIME] - rows[first, plant.TIME]
            if span > 0.0:
                total += (_value(rows[first + 1], which) - _value(rows[first], which)) / span
                known += 1.0
    return total / max(known, 1.0)


@uncounted
def interpolate_rows(
    rows: Floats, time_s: Floats, now: Floats, slopes: Floats, last: NDArray[np.int64]
) -> None:
    """Interpolate rows at times; before the first and after the last row nothing changes.

    Args:
        rows: (n, 16) what `plant` keeps, times ascending, two at least.
        time_s: (m,) any times, fastest when ascending.
        now: (16, m) filled with what is kept, at each time.
        slopes: (4, m) filled with what changes how fast.
        last: (m,) filled with the row before each time.
    """
    known = 0
    for number in range(time_s.size):
        known = _row_before(rows, time_s[number], known)
        last[number] = known
        begin = rows[known, plant.TIME]
        span = rows[known + 1, plant.TIME] - begin
        part = (time_s[number] - begin) / (span if span > 0.0 else 1.0)
        part = min(max(part, 0.0), 1.0)
        for column in range(plant.COLUMNS):
            low = rows[known, column]
            now[column, number] = low + (rows[known + 1, column] - low) * part
        for which in range(SLOPES):
            low = _slope(rows, known, which)
            slopes[which, number] = low + (_slope(rows, known + 1, which) - low) * part
