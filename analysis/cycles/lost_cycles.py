"""What a shift lost where nothing was recorded, in cycles and kg, with its uncertainty."""

from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.model.physical_units import NS_PER_S

#: Shorter holes lose no cycle.
HOLE_S: Final = 1.0


class LostCycles(NamedTuple):
    """Cycles that the recording cannot show.

    Attributes:
        cycles: expected number.
        u: its standard uncertainty.
        payload_kg: what they would have carried.
        payload_u_kg: likewise.
    """

    cycles: float
    u: float
    payload_kg: float
    payload_u_kg: float


def holes(excitation: pl.DataFrame, aligned: pl.DataFrame) -> list[tuple[int, int]]:
    """Stretches of a second or more in which a channel is missing, in ns, between its samples.

    Args:
        excitation: its times.
        aligned: `gap`, row by row.
    """
    t_ns = excitation["t_ns"].to_numpy()
    here = t_ns[~aligned["gap"].to_numpy()]
    if here.size < 2:
        return []
    wide = np.flatnonzero(np.diff(here) > HOLE_S * NS_PER_S)
    return [(int(here[k]), int(here[k + 1])) for k in wide]


def lost_cycles(cycles: pl.DataFrame, gaps: list[tuple[int, int]]) -> LostCycles:
    """Price what the holes hide: a cycle is lost when all of its loaded stretch lies in one.

    With a period P between dumps, hauls of D, as long as those that were seen, a hole G hides
    (G − D)/P cycles, nothing where the haul is longer; the number of whole periods in a stretch of
    chance place deviates by √(f(1−f)), f being the fraction over whole ones, and periods differ.
    Where no haul was seen whole, nothing is priced.

    Args:
        cycles: the frame.
        gaps: `holes`.
    """
    dumps = cycles["dump_t_ns"].drop_nulls().to_numpy() / NS_PER_S
    known = cycles.filter(pl.col("counted"))["payload_kg"].to_numpy()
    hauls = cycles["haul_s"].drop_nulls().to_numpy()
    if dumps.size < LIMITS.period_min_dumps or not known.size or not hauls.size:
        return LostCycles(0.0, 0.0, 0.0, 0.0)
    periods = np.diff(dumps)
    periods = periods[periods < LIMITS.idle_period_ratio * np.median(periods)]
    period, spread = float(np.mean(periods)), float(np.std(periods))
    expected = variance = 0.0
    for start, end in gaps:
        hidden = float(np.mean(np.maximum((end - start) / NS_PER_S - hauls, 0.0))) / period
        part = hidden % 1.0
        expected += hidden
        variance += part * (1.0 - part) + hidden * (spread / period) ** 2
    mean_kg, std_kg = float(np.mean(known)), float(np.std(known))
    return LostCycles(
        expected,
        float(np.sqrt(variance)),
        expected * mean_kg,
        float(np.sqrt(variance * mean_kg**2 + expected * std_kg**2)),
    )
