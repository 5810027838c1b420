"""Dumps shown by the boom: it is extended while the machine hardly moves.

The typical boom angle of a dump is taken from the log itself: from the boom's movement between each
loaded pass and the empty pass after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.loaded_states import (
    find_manoeuvres_after_digging,
    mark_rests_of_loads_by_mass,
)
from analysis.model.schema import get_column_values
from estimators.arrays import Bools, Floats, Ints

Span = tuple[int, int]


class BoomDump(NamedTuple):
    """A dump that the boom shows; times in ns.

    Attributes:
        start_ns: first time with the boom extended.
        end_ns: last time with the boom extended.
        bucket_emptied_ns: time when the bucket is emptied.
    """

    start_ns: int
    end_ns: int
    bucket_emptied_ns: int

    def is_near_any_time(self, times_ns: Ints, tolerance_ns: int = LIMITS.one_dump_ns) -> bool:
        """Whether one of these times is within `tolerance_ns` of the dump."""
        after, before = self.start_ns - tolerance_ns, self.end_ns + tolerance_ns
        return bool(((after <= times_ns) & (times_ns <= before)).any())


@dataclass(frozen=True)
class BoomDumps:
    """Dumps that the boom shows, in order of time.

    Attributes:
        shows_dumps: whether the boom shows dumps in this log; if not, their absence means nothing.
        dumps: all dumps found.
    """

    shows_dumps: bool
    dumps: tuple[BoomDump, ...] = ()

    def select_dumps_emptied_in_span(self, start_ns: int, end_ns: int) -> list[BoomDump]:
        """Dumps that emptied the bucket within a time span."""
        return [each for each in self.dumps if start_ns <= each.bucket_emptied_ns <= end_ns]

    def select_dumps_overlapping_span(self, start_ns: int, end_ns: int) -> list[BoomDump]:
        """Dumps whose boom movement overlaps a time span.

        A creeping machine may empty its bucket before the span.
        """
        return [each for each in self.dumps if start_ns <= each.end_ns and each.start_ns <= end_ns]

    def can_exclude_dump(self, start_ns: int, end_ns: int) -> bool:
        """Whether the boom reliably shows that there is no dump in a time span."""
        return self.shows_dumps and not self.select_dumps_overlapping_span(start_ns, end_ns)


#: Result for a log whose boom shows no dumps.
NO_DUMPS: Final = BoomDumps(shows_dumps=False)


def find_boom_dumps(
    aligned: pl.DataFrame, excitation: pl.DataFrame, unloading_spans: Sequence[Span] | None = None
) -> BoomDumps:
    """Find every dump of the boom.

    Args:
        aligned: frame with `boom_rad`, if measured.
        excitation: frame with phases and speed.
        unloading_spans: spans that each contain a dump according to the masses; None if unknown, in
            which case the typical reach is taken from all times at which the machine is slow.
    """
    t_ns, boom = excitation["t_ns"].to_numpy(), get_column_values(aligned, "boom_rad")
    slow = mark_standing_or_creeping_samples(excitation)
    whole = np.isfinite(boom)
    driving = whole & ~slow
    if not driving.any() or not (slow & whole).any():
        return NO_DUMPS
    away = boom - float(np.median(boom[driving]))
    if unloading_spans is None:
        reached = np.array([estimate_signed_dumping_deflection_rad(away[slow & whole])])
    else:
        reached = np.array(
            [
                find_largest_boom_deflection_rad(away, slow & whole, t_ns, span)
                for span in unloading_spans
            ]
        )
    typical_rad = float(np.median(reached)) if reached.size else 0.0
    if abs(typical_rad) < LIMITS.boom_min_deflection_rad or (
        unloading_spans is not None and len(unloading_spans) < LIMITS.boom_min_changes
    ):
        return NO_DUMPS
    reach = away / typical_rad
    out = whole & (reach > LIMITS.boom_out_fraction)
    stands = out & mark_standing_samples(excitation)
    inside_ns, standing_ns, standing_reach = t_ns[whole & ~out], t_ns[stands], reach[stands]
    spans = [
        trim_span_to_standstills(span, standing_ns, standing_reach)
        for span in group_boom_out_times_into_dumps(
            t_ns[out & slow], inside_ns, t_ns[driving & (reach < LIMITS.boom_in_fraction)]
        )
    ]
    spans = drop_truncated_dump(spans, inside_ns, int(t_ns[-1]))
    if (
        np.mean(reached / typical_rad > LIMITS.boom_out_fraction) < LIMITS.boom_change_fraction
        or len(spans) < LIMITS.boom_min_changes
    ):
        return NO_DUMPS
    dumps = [BoomDump(*span, find_emptying_time_ns(reach, t_ns, span)) for span in spans]
    return BoomDumps(shows_dumps=True, dumps=tuple(dumps))


def mark_standing_or_creeping_samples(excitation: pl.DataFrame) -> Bools:
    """Whether the machine stands or creeps at each sample, (n,)."""
    stands = mark_standing_samples(excitation)
    speed = np.abs(get_column_values(excitation, "speed_x_m_s"))
    moving = speed[np.isfinite(speed) & ~stands]
    if not moving.size:
        return stands
    return stands | (
        speed
        < LIMITS.creeping_speed_fraction * float(np.quantile(moving, LIMITS.reached_speed_quantile))
    )


def mark_standing_samples(excitation: pl.DataFrame) -> Bools:
    """Whether the machine stands at each sample, (n,)."""
    return (excitation["phase"] == "standstill").fill_null(value=False).to_numpy()


def estimate_signed_dumping_deflection_rad(deflection_rad: Floats) -> float:
    """Signed deflection of the boom at dumps: upwards, unless it moves much farther downwards.

    A boom whose usual position is halfway up is deflected both at the dump and at the pile.

    Args:
        deflection_rad: (n,) angle of the boom from its usual position, while slow.
    """
    low, high = np.quantile(deflection_rad, LIMITS.boom_deflection_quantiles)
    return float(high if high > LIMITS.boom_upward_fraction * abs(low) else low)


def find_largest_boom_deflection_rad(
    deflection_rad: Floats, is_slow: Bools, t_ns: Ints, span: Span
) -> float:
    """Largest deflection of the boom in a span while the machine is slow, signed; 0 if unknown."""
    first, last = np.searchsorted(t_ns, span)
    inside = deflection_rad[first : last + 1][is_slow[first : last + 1]]
    return float(inside[np.argmax(np.abs(inside))]) if inside.size else 0.0


def find_times_with_boom_up_ns(times_ns: Ints, boom_angle_rad: Floats, span: Span) -> Ints:
    """Times in a span at which the boom is close to its farthest reach in the span."""
    first, end = np.searchsorted(times_ns, span[0]), np.searchsorted(times_ns, span[1], "right")
    inside = boom_angle_rad[first:end]
    return times_ns[first:end][inside > LIMITS.boom_up_fraction * np.nanmax(inside, initial=0.0)]


def find_emptying_time_ns(boom_angle_rad: Floats, t_ns: Ints, span: Span) -> int:
    """Time in ns when the bucket is emptied: soon after the boom's farthest reach in a span."""
    up_ns = find_times_with_boom_up_ns(t_ns, boom_angle_rad, span)
    return int(up_ns[0]) + min(int(up_ns[-1] - up_ns[0]) // 2, LIMITS.emptying_ns)


def group_boom_out_times_into_dumps(
    boom_out_ns: Ints, boom_in_ns: Ints, driving_boom_in_ns: Ints
) -> list[Span]:
    """Spans of dumping, each first and last time in ns, joined over short pauses of one dump.

    Spans between which the boom does not return belong to one dump: the machine drives there with
    its boom extended. If it drives with the boom retracted, two dumps are separate.

    Args:
        boom_out_ns: (n,) times with the boom extended while the machine hardly moves.
        boom_in_ns: times with the boom retracted.
        driving_boom_in_ns: those of them at which the machine drives.
    """
    if not boom_out_ns.size:
        return []
    returns, drives = (
        np.diff(np.searchsorted(each, boom_out_ns)) > 0 for each in (boom_in_ns, driving_boom_in_ns)
    )
    is_apart = drives | (returns & (np.diff(boom_out_ns) > LIMITS.one_dump_ns))
    parts = np.split(boom_out_ns, np.flatnonzero(is_apart) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts]


def drop_truncated_dump(spans: list[Span], boom_in_ns: Ints, log_end_ns: int) -> list[Span]:
    """Drop the last dump if the recording ends before most of its usual duration."""
    if not spans or (boom_in_ns.size and boom_in_ns[-1] > spans[-1][1]):
        return spans
    usual_ns = float(np.median([end - start for start, end in spans]))
    half_empty = log_end_ns - spans[-1][0] >= LIMITS.emptied_fraction * usual_ns
    return spans if half_empty else spans[:-1]


def trim_span_to_standstills(span: Span, standstills_ns: Ints, boom_angle_rad: Floats) -> Span:
    """First to last standstill with the boom up within a span; the whole span if there is none.

    The boom may be extended long before, on the way to the dump; if the machine then stands, it
    dumps at standstill, but not while the boom only begins to rise.

    Args:
        span: first and last time with the boom extended.
        standstills_ns: (n,) times at standstill with the boom extended.
        boom_angle_rad: (n,) deflection of the boom at these times.
    """
    up_ns = find_times_with_boom_up_ns(standstills_ns, boom_angle_rad, span)
    return (int(up_ns[0]), int(up_ns[-1])) if up_ns.size else span


def find_load_change_indices_at_dumps(
    is_loaded: Bools, start_ns: Ints, end_ns: Ints, dumps: BoomDumps
) -> list[int]:
    """Indices of loaded manoeuvres after which the boom dumps before the next loaded one."""
    return [
        k
        for k in range(is_loaded.size - 1)
        if is_loaded[k]
        and is_loaded[k + 1]
        and dumps.select_dumps_emptied_in_span(int(end_ns[k]), int(start_ns[k + 1]))
    ]


def mark_manoeuvres_while_dumping(start_ns: Ints, end_ns: Ints, dumps: BoomDumps) -> Bools:
    """Mark manoeuvres during which the bucket is emptied, (manoeuvres,): their load changes."""
    dumped = np.array([each.bucket_emptied_ns for each in dumps.dumps], np.int64)
    return np.searchsorted(dumped, start_ns) < np.searchsorted(dumped, end_ns, "right")


def find_rests_of_loads(
    is_loaded: Bools,
    mass_and_u_kg: tuple[Floats, Floats],
    start_ns: Ints,
    end_ns: Ints,
    digging: pl.DataFrame,
    dumps: BoomDumps,
) -> tuple[Bools, tuple[int, ...]]:
    """Find the manoeuvres that carry the rest of a load dumped in parts.

    The rest is lighter than the load, was not dug, and is dumped sooner than a cycle lasts. If the
    boom shows no dumps, the masses alone decide.

    Args:
        is_loaded: (manoeuvres,) whether each is loaded.
        mass_and_u_kg: (manoeuvres,) mass of the load state of each, and its random uncertainty.
        start_ns: (manoeuvres,) start of each.
        end_ns: (manoeuvres,) end of each.
        digging: the frame `digging`.
        dumps: dumps seen in the boom angle.

    Returns:
        Whether each manoeuvre carries a rest, (manoeuvres,); and the times in ns at which rests are
        dumped.
    """
    if not dumps.shows_dumps:
        return mark_rests_of_loads_by_mass(is_loaded, mass_and_u_kg, start_ns, end_ns, digging), ()
    rests = np.zeros(is_loaded.size, np.bool_)
    dumped_ns = np.array([each.bucket_emptied_ns for each in dumps.dumps], np.int64)
    middle_ns = (start_ns + end_ns) // 2
    between = [(middle_ns > t) & (middle_ns < to) for t, to in pairwise(dumped_ns)]
    whole = [bool((~is_loaded[each]).any() and is_loaded[each].any()) for each in between]
    if sum(whole) < LIMITS.filling_min_cycles:
        return rests, ()
    times_ns: list[int] = []
    usual_ns = float(np.median(np.diff(dumped_ns)[whole]))
    dug_after = find_manoeuvres_after_digging(middle_ns, digging)
    mass_kg, u_kg = mass_and_u_kg
    for last in find_load_change_indices_at_dumps(is_loaded, start_ns, end_ns, dumps):
        first = last + 1
        at = int(np.searchsorted(dumped_ns, start_ns[first]))
        apart_kg = LIMITS.other_load_std * float(np.hypot(u_kg[last], u_kg[first]))
        is_lighter = mass_kg[first] < mass_kg[last] - apart_kg
        if not is_lighter or first in dug_after or not 0 < at < dumped_ns.size:
            continue
        if dumped_ns[at] - dumped_ns[at - 1] < LIMITS.rest_max_cycles * usual_ns:
            rests |= is_loaded & (middle_ns > dumped_ns[at - 1]) & (middle_ns < dumped_ns[at])
            times_ns.append(int(dumped_ns[at]))
    return rests, tuple(times_ns)
