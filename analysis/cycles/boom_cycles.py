"""Cycles shown by boom or digging but not by masses; they are counted, without a mass."""

import numpy as np
import polars as pl

from analysis.cycles.boom_dumps import ONE_DUMP_NS, BoomDumps, Span, find_boom_dumps
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.cycle_parts import CycleParts
from analysis.cycles.load_passes import Passes


def does_digging_contradict_boom(passes: Passes, digs: pl.DataFrame) -> bool:
    """Whether masses change so often that most fillings would be hauled twice.

    With loads too small for the ground, masses follow other alternating effects, such as the
    driving direction.

    Args:
        passes: the passes.
        digs: the frame `digging`.
    """
    if passes.dumps.shows_dumps or digs.height <= LIMITS.boom_min_cycles:
        return False
    begin_ns, end_ns = (np.sort(digs[name].to_numpy()) for name in ("start_t_ns", "end_t_ns"))
    fills = begin_ns[np.append(True, begin_ns[1:] - end_ns[:-1] > passes.one_filling_ns)]
    lasts_ns = np.diff(fills)
    one = lasts_ns <= LIMITS.one_cycle_ratio * lasts_ns.min(initial=np.iinfo(np.int64).max)
    if one.sum() < LIMITS.boom_min_cycles:
        return False
    hauled = np.diff(np.searchsorted(passes.start_ns[passes.loaded], fills))
    return float(np.mean(hauled[one] > 1)) > LIMITS.hauled_twice_fraction


def add_boom_cycles(
    parts: list[CycleParts],
    passes: Passes,
    digs: pl.DataFrame,
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
) -> tuple[list[CycleParts], bool]:
    """Add cycles that the boom shows; if it contradicts the masses, these are discarded.

    Args:
        parts: cycles by masses, with their dumps.
        passes: the passes.
        digs: the frame `digging`.
        aligned: frame with `boom_rad`, if measured.
        excitation: frame with the phases.

    Returns:
        The cycles, and whether boom and masses contradict each other.
    """
    seen = find_boom_dumps(aligned, excitation)
    times = np.array([part.dumped_ns for part in parts if part.dumped_ns is not None], np.int64)
    told = any(part.loaded is not None for part in parts)
    # no mass can change where none is known on either side: before the first pass, after the last
    agree = [
        each.is_near(times, LIMITS.dump_match_ns)
        for each in seen.dumps
        if told and passes.end_ns[0] <= each.end_ns and each.start_ns <= passes.start_ns[-1]
    ]
    contradicts = bool(agree) and float(np.mean(agree)) < LIMITS.dump_match_fraction
    if contradicts or not told:
        return _boom_cycle_parts(seen, digs) or parts, contradicts
    # sooner after a dump than half a cycle the machine is empty
    apart_ns = (
        int(LIMITS.min_dump_interval_cycles * float(np.median(np.diff(times))))
        if times.size > 1
        else 0
    )
    missed = [
        CycleParts(dump_ns=(each.start_ns, each.end_ns), dumped_ns=each.dumped_ns)
        for each in passes.dumps.dumps
        if not each.is_near(times, max(ONE_DUMP_NS, apart_ns))
    ]
    return sorted([*parts, *missed], key=_cycle_first_seen_ns), False


def _cycle_first_seen_ns(cycle: CycleParts) -> int:
    """Time of the first evidence of a cycle."""
    return next(span[0] for span in (cycle.dig_ns, cycle.haul_ns, cycle.dump_ns) if span)


def _boom_cycle_parts(boom_dumps: BoomDumps, digs: pl.DataFrame) -> list[CycleParts]:
    """Make a cycle for each dump of the boom, with the digging before it."""
    dug = sorted(digs.select("start_t_ns", "end_t_ns").iter_rows())
    before = [0, *(each.end_ns for each in boom_dumps.dumps)]
    return [
        CycleParts(
            _digging_span(dug, since_ns, each.start_ns),
            dump_ns=(each.start_ns, each.end_ns),
            dumped_ns=each.dumped_ns,
        )
        for since_ns, each in zip(before, boom_dumps.dumps, strict=False)
    ]


def _digging_span(dug: list[Span], since_ns: int, until_ns: int) -> Span | None:
    """First to last digging within a time span; None without digging."""
    inside = [span for span in dug if since_ns <= span[0] < until_ns]
    return (inside[0][0], inside[-1][1]) if inside else None
