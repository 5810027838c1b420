"""Dumps that the boom shows, by no mass: where it is out while the machine hardly moves.

How far out a dump is, is the log's own to tell: by the boom between loads and the empty passes
after them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.schema import values

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Span = tuple[int, int]

#: A boom that moves by so much, in rad, tells when it dumps.
BOOM_MOVES_RAD: Final = 0.15
#: A boom that is out again within so long, in ns, shakes its bucket.
ONE_DUMP_NS: Final = 10 * 10**9
#: A boom tells of dumps where it moves out in at least so many changes from loaded to empty,
_FEWEST: Final = 3
#: and in this share of them.
_MOSTLY: Final = 0.7
#: It is out beyond this share of how far it is out in a middling dump.
_OUT: Final = 0.5
#: A machine that dumps creeps at most at this share of the speed that it reaches,
_CREEPS: Final = 0.25
#: which is this quantile of its speed.
_REACHES: Final = 0.95


@dataclass(frozen=True)
class BoomDumps:
    """Dumps that the boom shows, in time.

    Attributes:
        tells: whether the boom shows dumps in this log; if not, that there is none tells nothing.
        spans: of each, when the boom is out, in ns.
    """

    tells: bool
    spans: tuple[Span, ...] = ()

    def within(self, start_ns: int, end_ns: int) -> list[Span]:
        """Those whose middle lies in a stretch of time."""
        return [span for span in self.spans if start_ns <= sum(span) // 2 <= end_ns]


#: Of a log whose boom shows none.
NO_DUMPS: Final = BoomDumps(tells=False)


def boom_dumps(aligned: pl.DataFrame, excitation: pl.DataFrame, known: Sequence[Span]) -> BoomDumps:
    """Find every dump of the boom.

    Args:
        aligned: `boom_rad`, where there is one.
        excitation: phases, and the speed.
        known: stretches in each of which a load was dumped, as masses tell.
    """
    t_ns, boom = excitation["t_ns"].to_numpy(), values(aligned, "boom_rad")
    slow = _slow(excitation)
    whole = np.isfinite(boom)
    driving = whole & ~slow
    if len(known) < _FEWEST or not driving.any():
        return NO_DUMPS
    away = boom - float(np.median(boom[driving]))
    reached = np.array([_farthest(away, slow & whole, t_ns, span) for span in known])
    typical_rad = float(np.median(reached))
    if abs(typical_rad) < BOOM_MOVES_RAD:
        return NO_DUMPS
    out = whole & slow & (away / typical_rad > _OUT)
    spans = _joined(t_ns, out)
    if np.mean(reached / typical_rad > _OUT) < _MOSTLY:
        return NO_DUMPS
    return BoomDumps(tells=True, spans=tuple(spans))


def _slow(excitation: pl.DataFrame) -> Bools:
    """Samples at which the machine stands or creeps."""
    stands = (excitation["phase"] == "standstill").fill_null(value=False).to_numpy()
    speed = np.abs(values(excitation, "speed_x_m_s"))
    moving = speed[np.isfinite(speed) & ~stands]
    if not moving.size:
        return stands
    return stands | (speed < _CREEPS * float(np.quantile(moving, _REACHES)))


def _farthest(away: Floats, slow: Bools, t_ns: Ints, span: Span) -> float:
    """How far the boom is out in a stretch of time, with its sign; 0 where nothing tells."""
    first, last = np.searchsorted(t_ns, span)
    inside = away[first : last + 1][slow[first : last + 1]]
    return float(inside[np.argmax(np.abs(inside))]) if inside.size else 0.0


def _joined(t_ns: Ints, out: Bools) -> list[Span]:
    """Stretches of samples that are out, over moments in which the bucket is shaken."""
    when = t_ns[out]
    if not when.size:
        return []
    parts = np.split(when, np.flatnonzero(np.diff(when) > ONE_DUMP_NS) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts]
