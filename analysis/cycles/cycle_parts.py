"""Parts of cycles in time: digging, haul and dump of each, with distances and speeds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.cycles.boom_dumps import mark_standing_or_creeping_samples, mark_standing_samples
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.load_passes import LoadPasses
from analysis.model.physical_units import NS_PER_S
from analysis.model.schema import get_column_values
from analysis.model.windows import find_flagged_runs
from analysis.weighing.load_changes import compute_finite_range
from estimators.arrays import Bools, Floats, Ints


class DumpStandstill(NamedTuple):
    """Standstill of a dump in ns, and whether the boom moves during it."""

    start_ns: int
    end_ns: int
    does_boom_move: bool


class DriveSummary(NamedTuple):
    """Motion within a time span.

    Attributes:
        distance_m: distance driven in both directions; None without a speed.
        top_speed_m_s: largest absolute speed; None without a speed.
        moving_s: recorded time in motion.
        standing_s: recorded time at standstill.
        hole_s: time without recorded samples.
    """

    distance_m: float | None
    top_speed_m_s: float | None
    moving_s: float
    standing_s: float
    hole_s: float


class CycleMotion(NamedTuple):
    """Motion of a cycle.

    Attributes:
        cycle: number of the cycle.
        haul_m: distance driven with the load, from the end of digging to the stop for dumping; None
            if digging or the stop was not detected, or without a speed.
        whole: motion from one dump to the next.
    """

    cycle: int
    haul_m: float | None
    whole: DriveSummary


class _DriveSamples(NamedTuple):
    """Samples of a recording: time, duration, speed, and whether the machine stands."""

    t_ns: Ints
    step_s: Floats
    speed_m_s: Floats
    stands: NDArray[np.bool_]
    recorded: NDArray[np.bool_]

    @classmethod
    def from_excitation(cls, excitation: pl.DataFrame) -> "_DriveSamples":
        t_ns = excitation["t_ns"].to_numpy()
        step_s = np.diff(t_ns, append=t_ns[-1:]) / NS_PER_S
        return cls(
            t_ns,
            np.where(step_s > LIMITS.longest_sample_s, 0.0, step_s),
            np.abs(get_column_values(excitation, "speed_x_m_s")),
            mark_standing_samples(excitation),
            excitation["phase"].is_not_null().to_numpy(),
        )

    def summarise_span(
        self, start_ns: int, end_ns: int, long_gaps_ns: Sequence[tuple[int, int]]
    ) -> DriveSummary:
        """Summarise the motion within a time span."""
        part = slice(*np.searchsorted(self.t_ns, [start_ns, end_ns]))
        step_s, speed = self.step_s[part], self.speed_m_s[part]
        known = np.isfinite(speed)
        moves = self.recorded[part] & ~self.stands[part]
        return DriveSummary(
            float(np.sum(speed[known] * step_s[known])) if known.any() else None,
            float(speed[known].max()) if known.any() else None,
            float(step_s[moves].sum()),
            float(step_s[self.stands[part]].sum()),
            sum(max(min(e, end_ns) - max(s, start_ns), 0) for s, e in long_gaps_ns) / NS_PER_S,
        )


@dataclass
class CycleParts:
    """Parts of one cycle; times in ns since the first aligned sample, None if not seen.

    Attributes:
        dig_ns: first and last sample of its digging.
        loaded_pass: number of its loaded pass.
        haul_ns: first and last sample in motion with the load.
        dump_ns: start and end of the stop for dumping.
        bucket_emptied_ns: time of the dump: farthest reach of the boom, or middle of `dump_ns`.
        empty_pass_before: number of the empty pass before the load.
        empty_pass_after: number of the empty pass after the load.
        unseen: whether the load was dumped in a gap of the recording.
        load_falls: whether the load falls on the way by more than is spilled.
    """

    dig_ns: tuple[int, int] | None = None
    loaded_pass: int | None = None
    haul_ns: tuple[int, int] | None = None
    dump_ns: tuple[int, int] | None = None
    bucket_emptied_ns: int | None = None
    empty_pass_before: int | None = None
    empty_pass_after: int | None = None
    unseen: bool = False
    load_falls: bool = False

    @property
    def end_of_last_part_ns(self) -> int:
        """End of the last part that was seen, in ns."""
        return [span for span in (self.dig_ns, self.haul_ns, self.dump_ns) if span][-1][1]

    @property
    def missing_mass_reason(self) -> str:
        """Why the cycle has no mass; empty if it has one."""
        if self.loaded_pass is None:
            return "no usable start with this load"
        if self.load_falls:
            return "the load falls on the way: a part is dropped, or loads are exchanged"
        if self.empty_pass_before is None and self.empty_pass_after is None:
            return "no empty pass to compare with"
        return ""

    def compute_weights_of_passes_in_payload(
        self, tare_coefficient_before: Floats, pass_count: int
    ) -> Floats:
        """(passes,) weights of the passes' masses in the payload.

        Args:
            tare_coefficient_before: (passes,) weight of the empty pass before each load, used if
                there is an empty pass after the load as well.
            pass_count: number of passes.
        """
        weights = np.zeros(pass_count)
        assert self.loaded_pass is not None
        weights[self.loaded_pass] = 1.0
        before, after = self.empty_pass_before, self.empty_pass_after
        if before is not None and after is not None:
            weights[before] -= tare_coefficient_before[self.loaded_pass]
            weights[after] -= 1.0 - tare_coefficient_before[self.loaded_pass]
        else:
            weights[after if before is None else before] = -1.0
        return weights


def split_cycles_into_parts(passes: LoadPasses, digging: pl.DataFrame) -> list[CycleParts]:
    """Assign passes and digging starts to cycles, in order of time.

    Each hauled load is a cycle, and so is digging that no weighed load follows.
    """
    events = [
        *((int(t), 1, n) for n, t in enumerate(passes.start_ns)),
        *((int(t), 0, n) for n, t in enumerate(digging["start_t_ns"])),
    ]
    ends = digging["end_t_ns"].to_list()
    cycles: list[CycleParts] = []
    now: CycleParts | None = None
    empty: int | None = None
    for start_ns, is_pass, number in sorted(events):
        if not is_pass:
            span = (start_ns, ends[number])
            # further digging before the next pass
            again = (
                now is not None
                and now.loaded_pass is None
                and now.dig_ns is not None
                and start_ns - now.dig_ns[1] < passes.max_filling_pause_ns
                and not passes.dumps.select_dumps_emptied_in_span(now.dig_ns[1], start_ns)
            )
            # a bucket not dumped since is still full, so that apparent digging does not fill it
            inside = (
                now is not None
                and now.haul_ns is not None
                and (
                    start_ns < now.haul_ns[1]
                    or passes.dumps.can_exclude_dump(now.haul_ns[0], start_ns)
                )
            )
            if again and now is not None and now.dig_ns is not None:
                now.dig_ns = (now.dig_ns[0], span[1])
            elif not inside:
                now = CycleParts(dig_ns=span, empty_pass_before=empty)
                cycles.append(now)
        elif passes.loaded[number]:
            if now is None or now.loaded_pass is not None:
                now = CycleParts(empty_pass_before=empty)
                cycles.append(now)
            now.loaded_pass = number
            now.haul_ns = (start_ns, int(passes.end_ns[number]))
        else:
            if now is not None:
                now.empty_pass_after = number
            now, empty = None, number
    return _set_nearest_empty_passes(cycles, passes)


def _set_nearest_empty_passes(cycles: list[CycleParts], passes: LoadPasses) -> list[CycleParts]:
    """Set the nearest empty passes before and after each loaded pass of the cycles."""
    for cycle in cycles:
        if cycle.loaded_pass is not None:
            beside = passes.find_empty_passes_beside(cycle.loaded_pass)
            cycle.empty_pass_before, cycle.empty_pass_after = beside
            cycle.load_falls = cycle.loaded_pass in passes.falling
    return cycles


def fill_in_dump_times(
    cycles: list[CycleParts], passes: LoadPasses, aligned: pl.DataFrame, excitation: pl.DataFrame
) -> None:
    """Set the time of each cycle's dump, in place.

    It is a dump that the boom shows, or else the standstill after the load with the most boom
    movement, or else a long gap of the recording, or the longest standstill. It stays None if the
    machine is neither seen empty nor digging afterwards.

    Args:
        cycles: cycles, whose `dump_ns` and `bucket_emptied_ns` are set.
        passes: the passes.
        aligned: frame with `boom_rad`, if measured.
        excitation: frame with the phases.
    """
    t_ns = excitation["t_ns"].to_numpy()
    stands, stops = mark_standing_samples(excitation), mark_standing_or_creeping_samples(excitation)
    boom = get_column_values(aligned, "boom_rad")
    for cycle, later in zip(cycles, [*cycles, None][1:], strict=True):
        ready = find_last_loaded_time_ns(cycle, passes)
        over = [int(ns) for ns in passes.start_ns[np.searchsorted(passes.start_ns, ready) :][:1]]
        if later is not None and later.dig_ns is not None and later.dig_ns[0] > ready:
            over.append(later.dig_ns[0])
        empty = min(over, default=int(t_ns[-1]))
        dumped = passes.dumps.select_dumps_overlapping_span(ready, empty)
        if not dumped and cycle.loaded_pass is None and over and not passes.dumps.shows_dumps:
            # neither masses nor boom: assume the dump where the machine stands or creeps longest
            inside = (t_ns > ready) & (t_ns < empty)
            cycle.dump_ns = find_longest_non_idle_standstill_ns(stops[inside], t_ns[inside])
            cycle.bucket_emptied_ns = cycle.dump_ns and sum(cycle.dump_ns) // 2
        if not dumped and (cycle.loaded_pass is None or not over):
            continue
        first, last = np.searchsorted(t_ns, [ready, empty])
        part = slice(first, last + 1)
        if dumped:
            cycle.dump_ns = extend_span_over_standstills(dumped[0][:2], stands[part], t_ns[part])
            cycle.bucket_emptied_ns = dumped[0].bucket_emptied_ns
            continue
        stand = choose_standstill_of_dump(stands[part], boom[part], t_ns[part])
        by_boom = stand is not None and stand.does_boom_move
        hole = None if by_boom else find_longest_data_gap_ns(t_ns[part])
        cycle.unseen = hole is not None
        found_ns = hole or (stand and stand[:2]) or (int(t_ns[first]), int(t_ns[last]))
        cycle.dump_ns, cycle.bucket_emptied_ns = found_ns, sum(found_ns) // 2
        if stand is not None and by_boom:
            cycle.bucket_emptied_ns = find_middle_of_boom_out_time_ns(
                boom[part], t_ns[part], *stand[:2]
            )


def find_last_loaded_time_ns(cycle: CycleParts, passes: LoadPasses) -> int:
    """Last time with the load, in ns: end of its pass, or of its digging."""
    if cycle.loaded_pass is not None:
        return int(passes.end_ns[cycle.loaded_pass])
    assert cycle.dig_ns is not None
    return cycle.dig_ns[1]


def extend_span_over_standstills(
    span: tuple[int, int], is_standstill: Bools, t_ns: Ints
) -> tuple[int, int]:
    """Extend a span over the standstills that adjoin its ends."""
    first, last = (int(k) for k in np.searchsorted(t_ns, span))
    last = min(last, t_ns.size - 1)
    while first > 0 and is_standstill[first - 1]:
        first -= 1
    while last + 1 < t_ns.size and is_standstill[last + 1]:
        last += 1
    return int(t_ns[first]), int(t_ns[last])


def find_longest_data_gap_ns(t_ns: Ints) -> tuple[int, int] | None:
    """Start and end in ns of the longest time without samples; None if it is short."""
    steps = np.diff(t_ns)
    if not steps.size or steps.max() < LIMITS.dump_gap_s * NS_PER_S:
        return None
    widest = int(np.argmax(steps))
    return int(t_ns[widest]), int(t_ns[widest + 1])


def find_longest_non_idle_standstill_ns(is_standstill: Bools, t_ns: Ints) -> tuple[int, int] | None:
    """Start and end in ns of the longest flagged run of at most `idle_s`; None without any."""
    begins, ends = find_flagged_runs(is_standstill)
    length = t_ns[ends] - t_ns[begins]
    length[length > LIMITS.idle_s * NS_PER_S] = 0
    if not length.any():
        return None
    best = int(np.argmax(length))
    return int(t_ns[begins[best]]), int(t_ns[ends[best]])


def choose_standstill_of_dump(
    is_standstill: Bools, boom_rad: NDArray[np.float64], t_ns: Ints
) -> DumpStandstill | None:
    """Choose the standstill in which the boom moves most, or else the longest; None without any.

    Args:
        is_standstill: (n,) flags of standstill.
        boom_rad: (n,) boom angle in rad.
        t_ns: (n,) time in ns.
    """
    begins, ends = find_flagged_runs(is_standstill)
    if not begins.size:
        return None
    moves = np.array(
        [compute_finite_range(boom_rad[b : e + 1]) for b, e in zip(begins, ends, strict=True)]
    )
    length = (t_ns[ends] - t_ns[begins]).astype(np.float64)
    by_boom = bool(moves.max() > LIMITS.boom_min_deflection_rad)
    best = int(np.argmax(moves if by_boom else length))
    return DumpStandstill(int(t_ns[begins[best]]), int(t_ns[ends[best]]), by_boom)


def find_middle_of_boom_out_time_ns(
    boom_rad: NDArray[np.float64], t_ns: Ints, start_ns: int, end_ns: int
) -> int:
    """Middle of the first time in which the boom is more than half extended, in ns.

    The standstill may last longer, as a machine may idle after a dump; later movements of the boom
    do not belong to the dump.
    """
    inside = (t_ns >= start_ns) & (t_ns <= end_ns) & np.isfinite(boom_rad)
    angle, when = boom_rad[inside], t_ns[inside]
    away = np.abs(angle - angle[0])
    out = when[away > away.max() / 2.0]
    times = np.split(out, np.flatnonzero(np.diff(out) > LIMITS.one_dump_ns) + 1)
    dump = next(each for each in times if each[-1] >= when[np.argmax(away)])
    return int(dump[0] + dump[-1]) // 2


def summarise_cycle_motion(
    cycles: pl.DataFrame, excitation: pl.DataFrame, long_gaps_ns: Sequence[tuple[int, int]]
) -> list[CycleMotion]:
    """Summarise the motion of each cycle.

    Args:
        cycles: the frame `cycles`.
        excitation: frame with times, phases and speed.
        long_gaps_ns: see `cycles_lost_in_gaps.find_spans_of_missing_channels_ns`.
    """
    samples = _DriveSamples.from_excitation(excitation)
    found: list[CycleMotion] = []
    for row in cycles.iter_rows(named=True):
        start_ns, end_ns = row["start_t_ns"], row["end_t_ns"]
        haul_m = None
        if row["dig_t_ns"] is not None and row["load_s"] is not None and row["haul_s"] is not None:
            loaded_ns = row["dig_t_ns"] + int(row["load_s"] * NS_PER_S)
            haul = samples.summarise_span(loaded_ns, loaded_ns + int(row["haul_s"] * NS_PER_S), ())
            haul_m = haul.distance_m
        whole = samples.summarise_span(start_ns, end_ns, long_gaps_ns)
        found.append(CycleMotion(row["cycle"], haul_m, whole))
    return found


def summarise_shift_motion(
    excitation: pl.DataFrame, long_gaps_ns: Sequence[tuple[int, int]]
) -> DriveSummary:
    """Summarise the motion of the whole shift; arguments as in `summarise_cycle_motion`."""
    t_ns = excitation["t_ns"].to_numpy()
    if not t_ns.size:
        return DriveSummary(None, None, 0.0, 0.0, 0.0)
    return _DriveSamples.from_excitation(excitation).summarise_span(
        int(t_ns[0]), int(t_ns[-1]) + 1, long_gaps_ns
    )


def find_idle_spans_ns(excitation: pl.DataFrame) -> list[tuple[int, int]]:
    """First and last sample in ns of each standstill longer than `idle_s`, in order of time."""
    t_ns = excitation["t_ns"].to_numpy()
    begins, ends = find_flagged_runs(mark_standing_samples(excitation))
    return [
        (int(t_ns[b]), int(t_ns[e]))
        for b, e in zip(begins, ends, strict=True)
        if (t_ns[e] - t_ns[b]) / NS_PER_S > LIMITS.idle_s
    ]
