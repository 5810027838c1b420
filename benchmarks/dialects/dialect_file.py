"""One drive as scopes, apps, motor controllers, robots and loggers write it: a file a dialect.

Written from what is known of these formats; no file is copied. Every file holds the same drive, so
that what a reader takes from it can be compared with what was driven.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats

RATE_HZ: Final = 50.0
ROWS: Final = 4000
MASS_KG: Final = 1200.0
RADIUS_M: Final = 0.35
GEAR: Final = 9.665
NM_PER_A: Final = 0.12
POLE_PAIRS: Final = 7
#: Friday, the day is beyond 12.
BEGIN: Final = datetime(2026, 11, 13, 8, 15, 30, tzinfo=UTC)


def _drive() -> dict[str, Floats]:
    """Starts and stops along a straight line, and what sensors would show."""
    random = np.random.default_rng(7)
    t = np.arange(ROWS) / RATE_HZ
    lap = t % 16.0
    top = 2.0 + 1.5 * np.sin(0.7 * (t // 16.0))
    ramp = np.clip(lap - 2.0, 0, 4) - np.clip(lap - 8.0, 0, 4)
    v = top * (ramp / 4.0) ** 2 * (3 - 2 * ramp / 4.0)
    a = np.gradient(v, t)
    force = MASS_KG * a + 90.0 * v + 120.0 * np.sign(v) * (v > 0.01)
    force = force + random.normal(0, 4.0, ROWS)
    torque = force * RADIUS_M
    # no sensor of these is still at a stand
    v = v + random.normal(0, 0.001, ROWS)
    wheel = v / RADIUS_M
    return {
        "t": t,
        "v": v,
        "a": a + random.normal(0, 0.02, ROWS),
        "F": force,
        "x": np.cumsum(v) / RATE_HZ,
        "left": torque / 2,
        "right": torque / 2,
        "motor_torque": torque / GEAR,
        "motor_rpm": wheel * GEAR * 60 / (2 * np.pi),
        "current": torque / GEAR / NM_PER_A,
        "wheel": wheel,
        "az": 9.80665 + random.normal(0, 0.02, ROWS),
        "volt": v / 10,
    }


DRIVE: Final = _drive()


@dataclass(frozen=True)
class DialectFile:
    """A file of the drive.

    Attributes:
        name: of the dialect.
        data: its bytes.
        suffix: of its name.
        fields: by quantity of the drive: the field, and by what the drive's numbers are multiplied.
        keys: answers to what its reader has to ask, as `--set` takes them.
        topic: of a quantity that is not in the first.
        units: lines of the machine file for fields that state none, as a person answers.
        channels: that no name tells, as a person adds them to the draft.
        t0_ns: log time of its first row in ns; None where it only counts.
    """

    name: str
    data: bytes
    fields: dict[str, tuple[str, float]]
    suffix: str = ".csv"
    keys: tuple[str, ...] = ()
    t0_ns: int | None = None
    topic: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    channels: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Style:
    """How cells and lines are written."""

    separator: str = ","
    decimal: str = "."
    digits: int = 5
    end: str = "\n"
    quote: bool = False
    tail: str = ""
    encoding: str = "utf-8"

    def cells(self, column: Sequence[Any]) -> Sequence[str]:
        """The cells of a column."""
        if isinstance(column, np.ndarray) and column.dtype == np.float64:
            texts = _written_numbers(column.tobytes(), self.digits, self.decimal)
        else:
            texts = [
                each if isinstance(each, str) else _written(each, self.digits, self.decimal)
                for each in column
            ]
        return [f'"{text}"' for text in texts] if self.quote else texts

    def table(self, columns: Sequence[Any], head: Sequence[str]) -> bytes:
        """Lines above, and the rows."""
        rows = map(self.separator.join, zip(*map(self.cells, columns), strict=True))
        ends = f"{self.tail}{self.end}"
        return "".join(
            [*(f"{line}{self.end}" for line in head), *(f"{row}{ends}" for row in rows)]
        ).encode(self.encoding)


def _written(value: float, digits: int, decimal: str) -> str:
    return f"{value:.{digits}f}".replace(".", decimal)


@cache
def _written_numbers(column: bytes, digits: int, decimal: str) -> tuple[str, ...]:
    """A column of the drive, which many dialects write alike."""
    values: list[float] = np.frombuffer(column).tolist()
    return tuple(_written(value, digits, decimal) for value in values)


@cache
def stamps(form: str, begin: datetime = BEGIN) -> tuple[str, ...]:
    """The rows' times as text; `%3f` has milliseconds."""
    found: list[str] = []
    for k in range(ROWS):
        moment = begin + timedelta(seconds=k / RATE_HZ)
        milli = f"{moment.microsecond // 1000:03d}"
        found.append(moment.strftime(form.replace("%3f", milli)))
    return tuple(found)


def as_integers(values: NDArray[Any], scale: float = 1.0) -> list[str]:
    """Integers as text."""
    return [str(round(float(x) * scale)) for x in values]


T0_NS: Final = int(BEGIN.timestamp()) * 10**9
MIDNIGHT_NS: Final = (8 * 3600 + 15 * 60 + 30) * 10**9
SI: Final = 1.0
KMH: Final = 3.6
#: Time, speed and force of each row, and its time by the clock.
T_S: Final = DRIVE["t"]
V_M_S: Final = DRIVE["v"]
V_KMH: Final = V_M_S * KMH
F_N: Final = DRIVE["F"]
CLOCK: Final = tuple(BEGIN + timedelta(seconds=k / RATE_HZ) for k in range(ROWS))
