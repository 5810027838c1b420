"""Cycles hidden by gaps of the recording: expected number and mass."""

from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.boom_dumps import mark_standing_samples
from analysis.cycles.cycle_limits import LIMITS
from analysis.model.physical_units import NS_PER_S


class LostCycles(NamedTuple):
    """Cycles hidden by gaps of the recording.

    Attributes:
        cycles: expected number.
        u: standard uncertainty of the number.
        payload_kg: expected total payload.
        payload_u_kg: standard uncertainty of that payload.
    """

    cycles: float
    u: float
    payload_kg: float
    payload_u_kg: float


def find_spans_of_missing_channels_ns(
    excitation: pl.DataFrame, aligned: pl.DataFrame
) -> list[tuple[int, int]]:
    """Spans longer than `cycle_gap_s` in which a channel is missing: start and end of each, in ns.

    Args:
        excitation: frame with the times.
        aligned: frame with `gap`, in the same rows.
    """
    t_ns = excitation["t_ns"].to_numpy()
    here = np.concatenate([t_ns[:1], t_ns[~aligned["gap"].to_numpy()], t_ns[-1:]])
    if here.size < 4:  # hardly any row has all channels
        return []
    wide = np.flatnonzero(np.diff(here) > LIMITS.cycle_gap_s * NS_PER_S)
    return [(int(here[k]), int(here[k + 1])) for k in wide]


def mark_gaps_that_may_be_work_breaks(
    gaps: list[tuple[int, int]], excitation: pl.DataFrame
) -> list[bool]:
    """For each gap, whether the machine stands on both sides, and for a long time on one."""
    known = excitation.drop_nulls("phase")
    t_ns, moves = known["t_ns"].to_numpy(), ~mark_standing_samples(known)
    moving_ns = t_ns[moves]

    def may_be_work_break(start_ns: int, end_ns: int) -> bool:
        # samples beside a gap may have no phase
        before, after = np.searchsorted(t_ns, start_ns, "right") - 1, np.searchsorted(t_ns, end_ns)
        sides = [int(side) for side in (before, after) if 0 <= side < t_ns.size]
        if not sides or moves[sides].any():
            return False
        at = np.searchsorted(moving_ns, start_ns)
        stopped, starts = np.append(t_ns[0], moving_ns)[at], np.append(moving_ns, t_ns[-1])[at]
        stands = [t_ns[side] - stopped if side == before else starts - t_ns[side] for side in sides]
        return bool(max(stands) > LIMITS.idle_s * NS_PER_S)

    return [may_be_work_break(*gap) for gap in gaps]


def estimate_cycles_lost_in_gaps(
    cycles: pl.DataFrame, gaps: list[tuple[int, int]], may_be_work_breaks: list[bool]
) -> LostCycles:
    """Estimate how many cycles the gaps of a log hide: those whose whole haul is inside a gap.

    With a period P between dumps and hauls of duration D, a gap G hides (G − D)/P cycles, none if
    hauls are longer. The number of whole periods in a randomly placed span has the standard
    deviation √(f(1−f)), with f the fractional part, and periods vary. Without a completely seen
    haul nothing is estimated. If gaps may be breaks, or hide more than a few cycles, any number
    from none to all is equally probable (JCGM 100, 4.3.7), in all such gaps alike. A gap at the end
    of a shift hides none.

    Args:
        cycles: the frame `cycles`.
        gaps: gaps from `find_spans_of_missing_channels_ns`.
        may_be_work_breaks: whether each gap may be a break, by `mark_gaps_that_may_be_work_breaks`.
    """
    dumps = cycles["dump_t_ns"].drop_nulls().to_numpy() / NS_PER_S
    known = cycles.filter(pl.col("counted"))["payload_kg"].to_numpy()
    hauls = cycles["haul_s"].drop_nulls().to_numpy()
    if dumps.size < LIMITS.period_min_dumps or not known.size or not hauls.size:
        return LostCycles(0.0, 0.0, 0.0, 0.0)
    periods = np.diff(dumps)
    periods = periods[periods < LIMITS.idle_period_ratio * np.median(periods)]
    period, spread = float(np.mean(periods)), float(np.std(periods))
    expected = variance = in_breaks = 0.0
    for (start, end), may_be_work_break in zip(gaps, may_be_work_breaks, strict=True):
        if end - start > LIMITS.break_max_s * NS_PER_S:
            continue
        hidden = float(np.mean(np.maximum((end - start) / NS_PER_S - hauls, 0.0))) / period
        part = hidden % 1.0
        variance += part * (1.0 - part) + hidden * (spread / period) ** 2
        if may_be_work_break or hidden > LIMITS.working_gap_max_cycles:
            in_breaks += hidden
        else:
            expected += hidden
    expected, variance = expected + in_breaks / 2.0, variance + in_breaks**2 / 12.0
    mean_kg, std_kg = float(np.mean(known)), float(np.std(known))
    return LostCycles(
        expected,
        float(np.sqrt(variance)),
        expected * mean_kg,
        float(np.sqrt(variance * mean_kg**2 + expected * std_kg**2)),
    )
