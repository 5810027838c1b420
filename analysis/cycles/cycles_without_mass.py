"""Cycles without a mass: their expected number and mass.

Digging, dumps of the boom and counted cycles are compared. Evidence from two of them is a cycle;
evidence from one alone is a cycle with a probability, which is higher if the log has no second
indicator and lower if it has one that shows nothing. Dumps of the boom that masses confirm raise
it; its uncertainty is common to all cycles that only the boom shows. Without digging and boom, the
rhythm decides: two cycle times of work between two dumps hide one cycle.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, Self

import numpy as np
import polars as pl

from analysis.cycles.boom_dumps import BoomDumps, Span, find_boom_dumps, mark_standing_samples
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.cycle_parts import CycleParts, fill_in_dump_times, split_cycles_into_parts
from analysis.cycles.load_passes import LoadPasses
from analysis.model.physical_units import NS_PER_S
from analysis.model.windows import find_flagged_runs
from analysis.weighing.growing_load import LoadChangeInMotion
from estimators.arrays import Ints


def do_digs_contradict_loaded_passes(passes: LoadPasses, digging: pl.DataFrame) -> bool:
    """Whether masses alternate so often that most bucket fillings would be hauled twice.

    If loads are small compared with the effects of the ground, masses alternate for other reasons,
    such as the driving direction.

    Args:
        passes: the passes.
        digging: the frame `digging`.
    """
    if passes.dumps.shows_dumps or digging.height <= LIMITS.boom_min_cycles:
        return False
    start_ns, end_ns = (np.sort(digging[name].to_numpy()) for name in ("start_t_ns", "end_t_ns"))
    fills = start_ns[np.append(True, start_ns[1:] - end_ns[:-1] > passes.max_filling_pause_ns)]
    lasts_ns = np.diff(fills)
    one = lasts_ns <= LIMITS.one_cycle_ratio * lasts_ns.min(initial=np.iinfo(np.int64).max)
    if one.sum() < LIMITS.boom_min_cycles:
        return False
    hauled = np.diff(np.searchsorted(passes.start_ns[passes.loaded], fills))
    return float(np.mean(hauled[one] > 1)) > LIMITS.hauled_twice_fraction


def find_cycle_parts(
    passes: LoadPasses,
    frames: Mapping[str, pl.DataFrame],
    excluded: Sequence[LoadChangeInMotion],
    *,
    adds_boom: bool,
) -> tuple[list[CycleParts], bool]:
    """Find the cycles of a log, also those that only digging, the boom or a lost start shows.

    Args:
        passes: the passes.
        frames: `aligned`, `excitation`, `digging` and `manoeuvres` of a run.
        excluded: manoeuvres excluded from the fit: their load changes, or no load explains them.
        adds_boom: whether dumps of the boom are cycles too.

    Returns:
        The cycles, and whether boom and masses contradict each other.
    """
    digging, motion = frames["digging"], (frames["aligned"], frames["excitation"])
    parts, contradicts = split_cycles_into_parts(passes, digging), False
    fill_in_dump_times(parts, passes, *motion)
    if adds_boom:
        parts, contradicts = add_boom_cycles(parts, passes, digging, *motion)
    if not contradicts:
        t_ns = motion[1]["t_ns"].to_numpy()
        parts = add_hauls_without_usable_start(parts, passes, excluded, frames["manoeuvres"], t_ns)
    return parts, contradicts


def add_boom_cycles(
    cycle_parts: list[CycleParts],
    passes: LoadPasses,
    digging: pl.DataFrame,
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
) -> tuple[list[CycleParts], bool]:
    """Add the cycles that only the boom shows; if it contradicts the masses, use the boom alone.

    Args:
        cycle_parts: cycles by the masses, with their dumps.
        passes: the passes.
        digging: the frame `digging`.
        aligned: frame with `boom_rad`, if measured.
        excitation: frame with the phases.

    Returns:
        The cycles, and whether boom and masses contradict each other.
    """
    seen = find_boom_dumps(aligned, excitation)
    times = np.array(
        [part.bucket_emptied_ns for part in cycle_parts if part.bucket_emptied_ns is not None],
        np.int64,
    )
    told = any(part.loaded_pass is not None for part in cycle_parts)
    explained_ns = np.append(times, np.array(passes.rest_dumped_ns, np.int64))
    # before the first and after the last pass the masses cannot show a change
    agree = [
        each.is_near_any_time(explained_ns, LIMITS.dump_match_ns)
        for each in seen.dumps
        if told and passes.end_ns[0] <= each.end_ns and each.start_ns <= passes.start_ns[-1]
    ]
    contradicts = bool(agree) and float(np.mean(agree)) < LIMITS.dump_match_fraction
    if contradicts or not told:
        return _make_cycles_from_dumps(seen, digging) or cycle_parts, contradicts
    # within half a cycle of a dump the machine is empty
    usual_ns = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    apart_ns = int(LIMITS.min_dump_interval_cycles * usual_ns)
    missed = [
        CycleParts(dump_ns=(each.start_ns, each.end_ns), bucket_emptied_ns=each.bucket_emptied_ns)
        for each in passes.dumps.dumps
        if not each.is_near_any_time(explained_ns, max(LIMITS.one_dump_ns, apart_ns))
    ]
    return sorted([*cycle_parts, *missed], key=_find_start_of_earliest_part_ns), False


def add_hauls_without_usable_start(
    cycle_parts: list[CycleParts],
    passes: LoadPasses,
    excluded: Sequence[LoadChangeInMotion],
    manoeuvres: pl.DataFrame,
    t_ns: Ints,
) -> list[CycleParts]:
    """Add the hauls whose manoeuvres are all excluded from the fit; of digging, fill in the haul.

    Such a manoeuvre is nearer to the loaded passes by its own mass, lies within an empty one or
    before all of them, and is a usual cycle away from the other hauls, as its own mass is as
    doubtful as its load. After the last empty drive a load may still be on board: none is added.

    Args:
        cycle_parts: cycles by the masses, with their dumps.
        passes: the passes; if their boom shows the dumps, it decides, and nothing is added.
        excluded: manoeuvres excluded from the fit: their load changes, or no load explains them.
        manoeuvres: frame with the times of the fitted manoeuvres.
        t_ns: (samples,) times of the samples.
    """
    if passes.dumps.shows_dumps or passes.loaded.all() or not passes.loaded.any():
        return cycle_parts
    hauls_ns = passes.start_ns[passes.loaded]
    if hauls_ns.size < LIMITS.period_min_dumps:
        return cycle_parts
    min_kg = sum(float(passes.mass_kg[of].mean()) for of in (passes.loaded, ~passes.loaded)) / 2.0
    spans_ns = [
        (int(t_ns[each.first]), int(t_ns[each.last]))
        for each in excluded
        if each.mean_mass_kg > min_kg
    ]
    spans_ns = [span for span in spans_ns if _is_while_empty(span, passes)]
    # hauls between which one is missing are no usual cycle apart, and starts of one haul even less
    together_ns = np.sort(np.append(hauls_ns, [first_ns for first_ns, _ in spans_ns]))
    since_ns = np.diff(together_ns)
    since_ns = since_ns[since_ns > LIMITS.one_haul_cycles * float(np.median(np.diff(hauls_ns)))]
    apart_ns = (1.0 - LIMITS.rhythm_tolerance) * float(np.median(since_ns))
    start_ns = manoeuvres["start_t_ns"].to_numpy()
    found = [*cycle_parts]
    for first_ns, last_ns in spans_ns:
        if not (np.abs(hauls_ns - first_ns) > apart_ns).all():
            continue
        hauls_ns = np.append(hauls_ns, first_ns)
        after = int(np.searchsorted(start_ns, first_ns))
        since_ns = int(start_ns[after - 1]) if after else 0
        dug = [part for part in found if part.dig_ns and part.haul_ns is None]
        dug = [part for part in dug if since_ns < (part.dig_ns or (0, 0))[0] < first_ns]
        part = dug[-1] if dug else CycleParts()
        if not dug:
            found.append(part)
        part.haul_ns = first_ns, last_ns
        if part.dump_ns is None:
            part.dump_ns = last_ns, int(start_ns[after])
            part.bucket_emptied_ns = sum(part.dump_ns) // 2
    return sorted(found, key=_find_start_of_earliest_part_ns)


def _is_while_empty(span_ns: Span, passes: LoadPasses) -> bool:
    """Whether a manoeuvre lies within an empty pass or before all passes."""
    number = int(np.searchsorted(passes.start_ns, span_ns[0])) - 1
    return number < 0 or (not passes.loaded[number] and span_ns[1] < passes.end_ns[number])


def _find_start_of_earliest_part_ns(cycle: CycleParts) -> int:
    """Time of the first evidence of a cycle."""
    return next(span[0] for span in (cycle.dig_ns, cycle.haul_ns, cycle.dump_ns) if span)


def _make_cycles_from_dumps(boom_dumps: BoomDumps, digging: pl.DataFrame) -> list[CycleParts]:
    """Make a cycle for each dump of the boom, with the digging before it."""
    dug = sorted(digging.select("start_t_ns", "end_t_ns").iter_rows())
    before = [0, *(each.end_ns for each in boom_dumps.dumps)]
    return [
        CycleParts(
            find_digging_span(dug, since_ns, each.start_ns),
            dump_ns=(each.start_ns, each.end_ns),
            bucket_emptied_ns=each.bucket_emptied_ns,
        )
        for since_ns, each in zip(before, boom_dumps.dumps, strict=False)
    ]


def find_digging_span(digging_spans: list[Span], start_ns: int, end_ns: int) -> Span | None:
    """Start of the first and end of the last digging within a time span; None without digging."""
    inside = [span for span in digging_spans if start_ns <= span[0] < end_ns]
    return (inside[0][0], inside[-1][1]) if inside else None


class UncountedCycles(NamedTuple):
    """Cycles without a mass.

    Attributes:
        dumps: number of boom dumps in the shift; None if the boom shows none.
        cycles: expected number of cycles without a mass.
        u: standard uncertainty of that number.
        on_board_kg: load on board when the recording ends; None without one.
        on_board_u_kg: standard uncertainty of `on_board_kg`.
    """

    dumps: int | None
    cycles: float
    u: float
    on_board_kg: float | None
    on_board_u_kg: float | None


def estimate_uncounted_cycle_count(
    cycles: pl.DataFrame, excitation: pl.DataFrame, aligned: pl.DataFrame
) -> UncountedCycles:
    """Estimate the number of cycles without a mass from digging, dumps of the boom and rhythm.

    Args:
        cycles: the frame `cycles`.
        excitation: frame with phases and speed.
        aligned: frame with `boom_rad`, if measured.
    """
    t_ns = excitation["t_ns"].to_numpy()
    end_ns = int(t_ns[-1]) if t_ns.size else 0
    times = cycles["dump_t_ns"].drop_nulls().to_list()
    boom = find_boom_dumps(
        aligned, excitation, [(t - LIMITS.one_dump_ns, t + LIMITS.one_dump_ns) for t in times]
    )
    likely, common_u = estimate_unweighed_cycle_probabilities_and_count_u(cycles, boom)
    if not boom.shows_dumps and not is_dig_detection_reliable(cycles):
        likely += estimate_missed_cycle_probabilities(np.array(sorted(times), np.int64), excitation)
    on_board = cycles.tail(1).filter(pl.col("quality") == "not dumped")
    load_kg = load_u_kg = None
    if on_board.height:
        load_kg, load_u_kg = on_board["payload_kg"][0], on_board["payload_u_kg"][0]
        goes_on = end_ns - int(on_board["end_t_ns"][0]) > LIMITS.unseen_dump_ns
        likely += [LIMITS.unseen_dump_probability] * (goes_on and not boom.shows_dumps)
    p = np.array(likely, np.float64)
    return UncountedCycles(
        len(boom.dumps) if boom.shows_dumps else None,
        float(p.sum()),
        float(np.hypot(np.sqrt((p * (1.0 - p)).sum()), common_u)),
        load_kg,
        load_u_kg,
    )


def estimate_unweighed_load_and_u_kg(
    cycle_count: float,
    cycle_count_u: float,
    mean_kg: float | None,
    std_kg: float | None,
    counted_payloads: int,
) -> tuple[float, float]:
    """Estimated total load of unweighed cycles, from the weighed ones, with its uncertainty.

    Args:
        cycle_count: number of unweighed cycles.
        cycle_count_u: standard uncertainty of that number.
        mean_kg: mean of the counted payloads.
        std_kg: standard deviation of the counted payloads.
        counted_payloads: number of counted payloads, for the uncertainty of their mean.
    """
    if mean_kg is None:
        return 0.0, 0.0
    spread_kg = LIMITS.single_load_std_fraction * abs(mean_kg) if std_kg is None else std_kg
    mean_u_kg = spread_kg / np.sqrt(max(counted_payloads, 1))
    parts = (cycle_count_u * mean_kg, np.sqrt(cycle_count) * spread_kg, cycle_count * mean_u_kg)
    return cycle_count * mean_kg, float(np.linalg.norm(parts))


class _BetaPosterior(NamedTuple):
    """Probability that evidence from a single indicator was a cycle.

    Attributes:
        probability: mean of the probability.
        u: standard uncertainty of the probability, common to all cycles with this evidence.
    """

    probability: float
    u: float

    @classmethod
    def from_trials(
        cls, prior_mean: float, confirmed_count: int = 0, denied_count: int = 0
    ) -> Self:
        """Posterior mean and standard deviation of a beta distribution.

        Args:
            prior_mean: mean before the trials, which counts as `LIMITS.witness_prior_trials`.
            confirmed_count: number of the indicator's cycles that masses confirm.
            denied_count: number of the indicator's cycles that masses do not confirm.
        """
        trials = LIMITS.witness_prior_trials + confirmed_count + denied_count
        mean = (LIMITS.witness_prior_trials * prior_mean + confirmed_count) / trials
        return cls(mean, float(np.sqrt(mean * (1.0 - mean) / (trials + 1.0))))


#: Evidence from two indicators was a cycle.
_CERTAIN: Final = _BetaPosterior(1.0, 0.0)


def estimate_unweighed_cycle_probabilities_and_count_u(
    cycles: pl.DataFrame, boom_dumps: BoomDumps
) -> tuple[list[float], float]:
    """Probability that each row without a mass was a cycle, and the u of their expected number."""
    blank = cycles.filter(pl.col("payload_kg").is_null())
    contradicted = _BetaPosterior.from_trials(LIMITS.contradicted_probability)
    alone = _BetaPosterior.from_trials(LIMITS.sole_witness_probability)
    only_dug = contradicted if boom_dumps.shows_dumps else alone
    only_dumped = (
        contradicted
        if is_dig_detection_reliable(cycles)
        else _estimate_probability_that_boom_dump_is_cycle(cycles, boom_dumps)
    )
    dug, dumped, hauled = (
        blank[name].is_not_null() for name in ("dig_t_ns", "dump_t_ns", "haul_s")
    )
    shown = [
        _CERTAIN
        if haul or (dig and dump and boom_dumps.shows_dumps)
        else only_dug
        if dig
        else only_dumped
        for dig, dump, haul in zip(dug, dumped, hauled, strict=True)
    ]
    # the uncertainty is common to all cycles with the same evidence
    parts = [shown.count(each) * each.u for each in {only_dug, only_dumped}]
    return [each.probability for each in shown], float(np.linalg.norm(parts))


def _estimate_probability_that_boom_dump_is_cycle(
    cycles: pl.DataFrame, boom_dumps: BoomDumps
) -> _BetaPosterior:
    """Probability that a dump of the boom was a cycle, from the dumps that masses confirm."""
    weighed = cycles.filter(pl.col("counted"))["dump_t_ns"].drop_nulls().to_numpy()
    every = cycles["dump_t_ns"].drop_nulls().to_numpy()
    return _BetaPosterior.from_trials(
        LIMITS.sole_witness_probability,
        confirmed_count=sum(dump.is_near_any_time(weighed) for dump in boom_dumps.dumps),
        denied_count=sum(not dump.is_near_any_time(every) for dump in boom_dumps.dumps),
    )


def is_dig_detection_reliable(cycles: pl.DataFrame) -> bool:
    """Whether most counted cycles show digging."""
    counted = cycles.filter("counted")
    dug = counted.height - counted["dig_t_ns"].null_count()
    return dug >= LIMITS.digging_witness_fraction * max(counted.height, 1)


def estimate_missed_cycle_probabilities(dumps_ns: Ints, excitation: pl.DataFrame) -> list[float]:
    """Probability of each cycle missing from the rhythm of dumps, by the rhythm's regularity.

    Args:
        dumps_ns: times of the dumps, ascending.
        excitation: frame with the phases; idling and gaps do not count as work.
    """
    if dumps_ns.size < LIMITS.rhythm_min_dumps:
        return []
    t_ns, stands = excitation["t_ns"].to_numpy(), mark_standing_samples(excitation)
    step_s = np.diff(t_ns, prepend=t_ns[0]) / NS_PER_S
    # cycles in gaps are estimated separately
    step_s[step_s > LIMITS.cycle_gap_s] = 0.0
    for begin, end in zip(*find_flagged_runs(stands), strict=True):
        if t_ns[end] - t_ns[begin] > LIMITS.idle_s * NS_PER_S:
            step_s[begin : end + 1] = 0.0
    worked_s = np.diff(np.interp(dumps_ns, t_ns, np.cumsum(step_s)))
    cycle_s = float(np.median(worked_s))
    steady = float(np.mean(np.abs(worked_s - cycle_s) < LIMITS.rhythm_tolerance * cycle_s))
    if steady < LIMITS.rhythm_min_fraction:
        return []
    missing = np.rint(worked_s / cycle_s).astype(np.int64) - 1
    # a whole number of cycles rather than one slow cycle
    whole = np.abs(worked_s - (missing + 1) * cycle_s) < LIMITS.rhythm_tolerance * cycle_s
    return [steady] * int(missing[whole].clip(0).sum())
