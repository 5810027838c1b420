"""How far and how fast each cycle drives, how long it stands, and the long stands of a shift."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.cycles.boom_dumps import standing
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.cycle_parts import IDLE_S
from analysis.model.physical_units import NS_PER_S
from analysis.model.schema import values
from analysis.model.windows import runs_of
from estimators.arrays import Floats, Ints


class DriveSummary(NamedTuple):
    """The motion in a stretch of time.

    Attributes:
        distance_m: driven, forward and in reverse; None where no speed is known.
        top_speed_m_s: the largest speed, either way; likewise.
        moving_s: recorded time that is no standstill.
        standing_s: recorded time at a standstill.
        hole_s: time without a recording.
    """

    distance_m: float | None
    top_speed_m_s: float | None
    moving_s: float
    standing_s: float
    hole_s: float


class CycleMotion(NamedTuple):
    """The motion of a cycle.

    Attributes:
        cycle: its number.
        haul_m: driven with the load, from the end of digging to the stand to dump; None where
            either was not seen, or no speed is known.
        whole: from one dump to the next.
    """

    cycle: int
    haul_m: float | None
    whole: DriveSummary


def summarise_cycle_motion(
    cycles: pl.DataFrame, excitation: pl.DataFrame, holes_ns: Sequence[tuple[int, int]]
) -> list[CycleMotion]:
    """The motion of each cycle.

    Args:
        cycles: the frame.
        excitation: times, phases and speed.
        holes_ns: see `lost_cycles.holes`.
    """
    samples = _DriveSamples.of(excitation)
    found: list[CycleMotion] = []
    for row in cycles.iter_rows(named=True):
        start_ns, end_ns = row["start_t_ns"], row["end_t_ns"]
        haul_m = None
        if row["dig_t_ns"] is not None and row["load_s"] is not None and row["haul_s"] is not None:
            loaded_ns = row["dig_t_ns"] + int(row["load_s"] * NS_PER_S)
            haul = samples.during(loaded_ns, loaded_ns + int(row["haul_s"] * NS_PER_S), ())
            haul_m = haul.distance_m
        whole = samples.during(start_ns, end_ns, holes_ns)
        found.append(CycleMotion(row["cycle"], haul_m, whole))
    return found


def summarise_shift_motion(
    excitation: pl.DataFrame, holes_ns: Sequence[tuple[int, int]]
) -> DriveSummary:
    """The motion of the whole shift; arguments as of `summarise_cycle_motion`."""
    t_ns = excitation["t_ns"].to_numpy()
    if not t_ns.size:
        return DriveSummary(None, None, 0.0, 0.0, 0.0)
    return _DriveSamples.of(excitation).during(int(t_ns[0]), int(t_ns[-1]) + 1, holes_ns)


def idle_stands(excitation: pl.DataFrame) -> list[tuple[int, int]]:
    """The stands of more than `IDLE_S`, first and last sample in ns, in time."""
    if excitation.is_empty():
        return []
    t_ns = excitation["t_ns"].to_numpy()
    begins, ends = runs_of(standing(excitation))
    return [
        (int(t_ns[b]), int(t_ns[e]))
        for b, e in zip(begins, ends, strict=True)
        if (t_ns[e] - t_ns[b]) / NS_PER_S > IDLE_S
    ]


class _DriveSamples(NamedTuple):
    """Samples of a recording: time, time that each stands for, speed, and whether it stands."""

    t_ns: Ints
    step_s: Floats
    speed_m_s: Floats
    stands: NDArray[np.bool_]
    recorded: NDArray[np.bool_]

    @classmethod
    def of(cls, excitation: pl.DataFrame) -> "_DriveSamples":
        t_ns = excitation["t_ns"].to_numpy()
        step_s = np.diff(t_ns, append=t_ns[-1:]) / NS_PER_S
        return cls(
            t_ns,
            np.where(step_s > LIMITS.longest_sample_s, 0.0, step_s),
            np.abs(values(excitation, "speed_x_m_s")),
            standing(excitation),
            excitation["phase"].is_not_null().to_numpy(),
        )

    def during(
        self, start_ns: int, end_ns: int, holes_ns: Sequence[tuple[int, int]]
    ) -> DriveSummary:
        """What they say of a stretch of time."""
        part = slice(*np.searchsorted(self.t_ns, [start_ns, end_ns]))
        step_s, speed = self.step_s[part], self.speed_m_s[part]
        known = np.isfinite(speed)
        moves = self.recorded[part] & ~self.stands[part]
        return DriveSummary(
            float(np.sum(speed[known] * step_s[known])) if known.any() else None,
            float(speed[known].max()) if known.any() else None,
            float(step_s[moves].sum()),
            float(step_s[self.stands[part]].sum()),
            sum(max(min(e, end_ns) - max(s, start_ns), 0) for s, e in holes_ns) / NS_PER_S,
        )
