"""Whether what was followed is what the replay of the finished log has, bit for bit.

Digests by the minute are kept, not the rows, so that memory does not grow with the shift.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.schema import REASON
from analysis.online.follower import FollowedRow

GATE: Final = "gate"
_MINUTE_NS: Final = 60 * 10**9
_THETA: Final = ("mass_kg", "friction_x_N_s_m", "coulomb_x_N")
_REASONS: Final = {name: number for number, name in enumerate(REASON.categories)}


@dataclass(frozen=True, slots=True)
class Agreement:
    """Of the gate or of a method.

    Attributes:
        name: `gate`, or the method.
        rows: that were followed.
        replayed: that the replay has.
        differs_from_s: from the first row; None where all rows are the same.
    """

    name: str
    rows: int
    replayed: int
    differs_from_s: float | None


@dataclass(slots=True)
class _Minutes:
    """Digests of rows, by the minute."""

    rows: int = 0
    digests: dict[int, bytes] = field(default_factory=dict)

    def add(self, t_ns: int, numbers: NDArray[np.float64]) -> None:
        # each digest is of the rows and of the digest before, so that none has to be kept open
        minute = t_ns // _MINUTE_NS
        row = np.int64(t_ns).tobytes() + np.where(np.isnan(numbers), np.nan, numbers).tobytes()
        self.digests[minute] = hashlib.sha256(self.digests.get(minute, b"") + row).digest()
        self.rows += 1

    def differs_from_s(self, other: "_Minutes") -> float | None:
        minutes = sorted(self.digests.keys() | other.digests.keys())
        for minute in minutes:
            mine, theirs = self.digests.get(minute), other.digests.get(minute)
            if mine is None or theirs is None or mine != theirs:
                return minute * _MINUTE_NS / 1e9
        return None


class FollowedDigests:
    """What the gate decided and the methods estimated, as it was followed."""

    def __init__(self) -> None:
        self._minutes: dict[str, _Minutes] = {}

    def add(self, rows: Iterable[FollowedRow]) -> None:
        """Take the next rows."""
        for row in rows:
            if row.gate is not None:
                code = np.array([_REASONS[row.gate.reason]], np.float64)
                self._of(GATE).add(row.t_ns, code)
            for method, (t_ns, estimate) in row.estimates.items():
                self._of(method).add(t_ns, estimate.theta)

    def compare(self, frames: Mapping[str, pl.DataFrame]) -> list[Agreement]:
        """Compare with the frames of a replay."""
        found: list[Agreement] = []
        for name, replayed in _replayed(frames).items():
            mine = self._minutes.get(name, _Minutes())
            found.append(Agreement(name, mine.rows, replayed.rows, mine.differs_from_s(replayed)))
        return found

    def _of(self, name: str) -> _Minutes:
        return self._minutes.setdefault(name, _Minutes())


def _replayed(frames: Mapping[str, pl.DataFrame]) -> dict[str, _Minutes]:
    gate = frames["gate"]
    codes = gate["reason_x"].cast(pl.String).replace_strict(_REASONS, return_dtype=pl.Float64)
    found = {GATE: _digested(gate["t_ns"], codes.to_numpy()[:, None])}
    for name, frame in frames.items():
        method = name.removeprefix("estimates/")
        if method != name and "mass_kg" in frame.columns:
            frame = frame.drop_nulls("t_ns")
            theta = frame.select(c for c in _THETA if c in frame.columns).cast(pl.Float64)
            found[method] = _digested(frame["t_ns"], theta.fill_null(np.nan).to_numpy())
    return found


def _digested(t_ns: pl.Series, numbers: NDArray[np.float64]) -> _Minutes:
    minutes = _Minutes()
    for t, row in zip(t_ns.to_list(), np.ascontiguousarray(numbers), strict=True):
        minutes.add(t, row)
    return minutes
