"""Passes: manoeuvres between two changes of load, and their mass.

A pass is a sequence of manoeuvres that are all loaded or all empty. States that differ by less than
loaded from empty (spillage, a state split in two) belong to one pass.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.cycles.boom_dumps import (
    NO_DUMPS,
    BoomDumps,
    find_boom_dumps,
    find_load_change_indices_at_dumps,
    find_rests_of_loads,
    mark_manoeuvres_while_dumping,
)
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.loaded_states import (
    classify_loaded_states,
    find_ends_of_hauls,
    find_falling_passes,
)
from analysis.weighing.empty_mass_step import EmptyMassStep, find_empty_mass_step_of_manoeuvres
from analysis.weighing.fit_columns import mark_plausible_masses
from estimators.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class LoadPasses:
    """Passes in order of time.

    Attributes:
        pass_of_manoeuvre: (manoeuvres,) pass of each manoeuvre.
        share: (manoeuvres,) weight in the mass of its pass; the weights of a pass add up to 1.
        loaded: (passes,) whether each pass is loaded.
        mass_kg: (passes,) mass.
        u_kg: (passes,) random uncertainty of the mass, from noise and scatter of the manoeuvres.
        start_ns: (passes,) first fitted sample.
        end_ns: (passes,) last fitted sample.
        max_filling_pause_ns: longest pause between digging starts that fill the same bucket.
        dumps: dumps seen in the boom angle.
        rest_dumped_ns: (rests,) times at which the rest of a load is dumped.
        drift_1: (passes,) relative drift of the empty machine's mass at each pass.
        step_kg: (passes,) change of the empty machine's mass by a step before each pass.
        falling: numbers of the passes whose load falls on the way by more than is spilled.
    """

    pass_of_manoeuvre: Ints
    share: Floats
    loaded: Bools
    mass_kg: Floats
    u_kg: Floats
    start_ns: Ints
    end_ns: Ints
    max_filling_pause_ns: int = LIMITS.max_filling_pause_ns
    dumps: BoomDumps = NO_DUMPS
    rest_dumped_ns: tuple[int, ...] = ()
    drift_1: Floats | float = 0.0
    step_kg: Floats | float = 0.0
    falling: tuple[int, ...] = ()

    @property
    def drift_corrected_masses_kg(self) -> Floats:
        """(passes,) mass of each pass, corrected for drift and step of the empty machine's mass.

        The gain of the force is its mean over the log.
        """
        return (self.mass_kg - self.step_kg) / (1.0 + self.drift_1)

    def find_empty_passes_beside(self, number: int) -> tuple[int | None, int | None]:
        """Numbers of the nearest empty passes before and after a pass; None where there is none.

        Where the empty machine's mass has a step, both are on the same side of it as the pass.
        """
        step_kg = np.broadcast_to(self.step_kg, self.loaded.shape)
        empties = np.flatnonzero(~self.loaded & (step_kg == step_kg[number]))
        place = int(np.searchsorted(empties, number))
        return (
            int(empties[place - 1]) if place > 0 else None,
            int(empties[place]) if place < empties.size else None,
        )

    def compute_averaging_weights_of_empty_passes(self, stated_kg: float | None) -> Floats:
        """(passes,) weight of each empty pass in the average mass of the empty machine.

        If that mass has a step, only the passes on the side nearer to the stated mass have weight.

        Args:
            stated_kg: stated mass of the empty machine, if known.
        """
        share = np.where(self.loaded, 0.0, 1.0 / self.u_kg**2)
        step_kg = np.broadcast_to(self.step_kg, share.shape)
        if stated_kg is not None and np.ptp(step_kg) > 0.0:
            sides = [np.where(step_kg == each, share, 0.0) for each in np.unique(step_kg)]
            share = min(
                (side for side in sides if side.any()),
                key=lambda side: abs(float(side @ self.mass_kg) / side.sum() - stated_kg),
            )
        return share


#: Result for a log in which loaded and empty cannot be distinguished.
NO_PASSES: Final = LoadPasses(
    np.zeros(0, np.int64),
    np.zeros(0),
    np.zeros(0, np.bool_),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
)


def find_load_passes(
    loads: pl.DataFrame,
    manoeuvres: pl.DataFrame,
    digging: pl.DataFrame,
    aligned: pl.DataFrame | None = None,
    excitation: pl.DataFrame | None = None,
    drift_1: Floats | float = 0.0,
) -> LoadPasses | None:
    """Group manoeuvres into passes; None if loaded and empty cannot be distinguished.

    Args:
        loads: frame with the scatter.
        manoeuvres: frame with states and masses.
        digging: the frame `digging`; the machine is empty before a digging start and loaded after.
        aligned: frame with the boom, if measured.
        excitation: frame with phases and speed.
        drift_1: (states,) relative drift of the empty machine's mass at each state.
    """
    if manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count():
        return None
    level = manoeuvres["mass_kg"].to_numpy()
    std = manoeuvres["mass_std_kg"].to_numpy()
    state = manoeuvres["load_id"].to_numpy()
    begin, end = (manoeuvres[name].to_numpy() for name in ("start_t_ns", "end_t_ns"))
    scatter_kg = float(loads["scatter_kg"].fill_null(0.0).max() or 0.0)  # pyright: ignore[reportArgumentType]
    weight = 1.0 / (std**2 + scatter_kg**2)
    step = find_empty_mass_step_of_manoeuvres(manoeuvres)
    # a step also looks like a drift, but the step describes it better
    drift_1 = drift_1 if step is None else 0.0
    state, step_kg = split_states_at_step(state, step)
    total = np.bincount(state, weight)
    mass_kg = np.bincount(state, weight * level) / total
    u_kg = 1.0 / np.sqrt(total)
    first_kg = (mass_kg - step_kg) / (1.0 + drift_1)
    # a step splits states, which then are not those of the table
    has_table = step is None and "empty" in loads.columns
    is_empty = loads["empty"].to_numpy() if has_table else None
    loaded = classify_loaded_states(first_kg, u_kg, state, (begin, end), digging, is_empty)
    if loaded is None:
        return None
    of_state, dumps, rest_dumped_ns = loaded[state], NO_DUMPS, tuple[int, ...]()
    if aligned is not None and excitation is not None:
        of_manoeuvre = mass_kg[state] - step_kg[state], u_kg[state]
        dumps = find_dumps_of_loads(of_state, begin, aligned, excitation)
        of_state = correct_loaded_flags_at_dumps(of_state, begin, end, digging, dumps)
        rests, rest_dumped_ns = find_rests_of_loads(
            of_state, of_manoeuvre, begin, end, digging, dumps
        )
        of_state &= ~rests
    pause_ns = compute_max_filling_pause_ns(of_state, begin, end, digging)
    parts = np.diff(of_state) != 0
    parts[find_manoeuvres_after_refills(of_state, begin, end, digging, dumps, pause_ns)] = True
    if digging.height < LIMITS.digging_min_fraction * np.count_nonzero(parts & of_state[:-1]):
        parts[find_load_change_indices_at_dumps(of_state, begin, end, dumps)] = True
    hauls_nothing = mark_short_hauls(of_state, parts, begin, end, digging)
    of_state = of_state & ~hauls_nothing
    parts = (np.diff(of_state) != 0) | (parts & of_state[1:])
    if step is not None:  # a pass does not span a step
        parts[step.first_manoeuvre_after - 1] |= not of_state[step.first_manoeuvre_after]
    of = np.cumsum(np.append(0, parts)).astype(np.int64)
    first = np.flatnonzero(np.append(True, np.diff(of) > 0))
    last = np.append(first[1:] - 1, of.size - 1)
    has_load = ~(
        mark_manoeuvres_while_dumping(begin, end, dumps) | ~mark_plausible_masses(mass_kg)[state]
    )
    other = mark_other_loads_of_passes(has_load, of_state, of, state, mass_kg - step_kg, u_kg)
    for k in np.flatnonzero(other[:-1] & ~other[1:] & ~of_state[:-1] & (np.diff(of) == 0)):
        rest_dumped_ns += tuple(
            each.bucket_emptied_ns
            for each in dumps.select_dumps_emptied_in_span(int(end[k]), int(begin[k + 1]))
        )
    # what digs, or shows its dumps by the boom, has a pass for each dump
    may_fall = has_load & (digging.is_empty() and not dumps.shows_dumps)
    no_mass = ~has_load | other | hauls_nothing
    no_mass |= step_kg[state] != step_kg[state[first]][of]
    left = np.where(no_mass, 0.0, weight)
    # a pass without other manoeuvres keeps its weights
    weight = np.where(np.bincount(of, left)[of] > 0.0, left, weight)
    total = np.bincount(of, weight)
    # a pass ends before the machine dumps
    counts = np.flatnonzero(weight > 0.0)
    last[of[counts]] = counts
    return LoadPasses(
        of,
        weight / total[of],
        of_state[first],
        np.bincount(of, weight * level) / total,
        1.0 / np.sqrt(total),
        begin[first],
        end[last],
        pause_ns,
        dumps,
        rest_dumped_ns,
        np.broadcast_to(drift_1, mass_kg.shape)[state[first]],
        step_kg[state[first]],
        find_falling_passes(may_fall, of_state, of, state, mass_kg - step_kg, u_kg),
    )


def find_dumps_of_loads(
    is_loaded: Bools, start_ns: Ints, aligned: pl.DataFrame, excitation: pl.DataFrame
) -> BoomDumps:
    """Find the dumps of the boom, given the manoeuvres between which the masses show one."""
    emptied = find_ends_of_hauls(is_loaded)
    # a machine that creeps to the dump may empty its bucket before the manoeuvre ends
    known = [(int(start_ns[k]), int(start_ns[k + 1])) for k in emptied]
    return find_boom_dumps(aligned, excitation, known)


def split_states_at_step(state: Ints, step: EmptyMassStep | None) -> tuple[Ints, Floats]:
    """Split states that span a step: states of the manoeuvres, and (states,) their step in kg."""
    if step is None:
        return state, np.zeros(int(state.max()) + 1)
    after = np.arange(state.size) >= step.first_manoeuvre_after
    _, split = np.unique(2 * state + after, return_inverse=True)
    gained_kg = np.zeros(int(split.max()) + 1)
    gained_kg[split[after]] = step.change_kg
    return split.astype(np.int64), gained_kg


def mark_short_hauls(
    is_loaded: Bools, is_pass_border: Bools, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame
) -> Bools:
    """Mark the manoeuvres of very short hauls without digging before, (manoeuvres,).

    A machine that backs out after a dump may look loaded: a short manoeuvre determines its mass
    poorly, and a lowered boom looks like a dump. Such a manoeuvre has empty ones shortly before and
    after it; otherwise it is part of a haul whose rest was not weighed.

    Args:
        is_loaded: (manoeuvres,) whether each is loaded.
        is_pass_border: (manoeuvres - 1,) whether a new pass begins after each.
        start_ns: (manoeuvres,) start of each.
        end_ns: (manoeuvres,) end of each.
        digging: the frame `digging`.
    """
    found = np.zeros(is_loaded.size, np.bool_)
    first = np.flatnonzero(np.append(True, is_pass_border))
    last = np.append(first[1:] - 1, is_loaded.size - 1)
    # the first and the last load of a log may be cut off
    inner = np.flatnonzero(is_loaded[first[1:-1]]) + 1
    first, last = first[inner], last[inner]
    if first.size < LIMITS.filling_min_cycles:
        return found
    spans_ns = end_ns[last] - start_ns[first]
    between_ns = start_ns[last + 1] - end_ns[first - 1]
    is_short = spans_ns < LIMITS.short_haul_fraction * np.median(spans_ns)
    is_short &= between_ns < LIMITS.short_between_fraction * np.median(between_ns)
    dug_ns = digging["start_t_ns"].to_numpy()
    for k, to in zip(first[is_short].tolist(), last[is_short].tolist(), strict=True):
        found[k : to + 1] = not np.any((dug_ns >= start_ns[k - 1]) & (dug_ns < end_ns[to]))
    return found


def compute_max_filling_pause_ns(
    is_loaded: Bools, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame
) -> int:
    """Longest pause in ns between starts that fill the same bucket, shorter than a cycle."""
    starts = np.sort(digging["start_t_ns"].to_numpy())
    stops = np.sort(digging["end_t_ns"].to_numpy())
    middle = (start_ns + end_ns) // 2
    apart = [
        int(start - stop)
        for stop, start in zip(stops[:-1], starts[1:], strict=True)
        if (seen := is_loaded[(middle > stop) & (middle < start)]).any() and not seen.all()
    ]
    if len(apart) < LIMITS.filling_min_cycles:
        return LIMITS.max_filling_pause_ns
    return min(LIMITS.max_filling_pause_ns, int(LIMITS.one_filling_cycles * np.median(apart)))


def find_manoeuvres_after_refills(
    is_loaded: Bools,
    start_ns: Ints,
    end_ns: Ints,
    digging: pl.DataFrame,
    dumps: BoomDumps,
    max_filling_pause_ns: int,
) -> list[int]:
    """Indices of loaded manoeuvres after which a loaded machine digs again and is loaded again.

    It must have dumped in between, as the boom or the elapsed time shows; its empty drive was too
    short to be weighed, or was not recorded.
    """
    found: list[int] = []
    last_ns = -max_filling_pause_ns
    for start, stop in digging.select("start_t_ns", "end_t_ns").sort("start_t_ns").iter_rows():
        after = int(np.searchsorted(start_ns, start, "left"))
        if 0 < after < is_loaded.size and is_loaded[after - 1] and is_loaded[after]:
            empties = np.flatnonzero(~is_loaded[:after])
            first = int(empties[-1]) + 1 if empties.size else 0
            since_ns = max(int(start_ns[first]), last_ns)
            dumped = bool(dumps.select_dumps_emptied_in_span(int(end_ns[after - 1]), start))
            is_late = start - since_ns > max_filling_pause_ns
            may_have = is_late and not dumps.can_exclude_dump(since_ns, start)
            # a manoeuvre during the digging is no haul
            if (may_have or dumped) and end_ns[after - 1] <= start:
                found.append(after - 1)
        last_ns = stop
    return found


def correct_loaded_flags_at_dumps(
    is_loaded: Bools, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame, dumps: BoomDumps
) -> Bools:
    """Whether each manoeuvre is loaded, (manoeuvres,), with the dumps at the times of the boom.

    If the masses show a dump a few manoeuvres before or after the boom, the flags of the manoeuvres
    in between are changed.
    """
    at = [int(np.searchsorted(start_ns, each.bucket_emptied_ns)) for each in dumps.dumps]
    dug = np.unique(np.searchsorted(start_ns, digging["start_t_ns"].to_numpy()))
    moved = is_loaded.copy()
    for first in find_ends_of_hauls(is_loaded) + 1:
        if dumps.select_dumps_emptied_in_span(int(end_ns[first - 1]), int(start_ns[first])):
            continue
        # search from one filling to the next
        low = int(max(dug[dug < first], default=0))
        high = int(min(dug[dug >= first], default=is_loaded.size))
        places = [place for place in at if low < place < high]
        if len(places) == 1:
            moved[places[0] : first] = False
            moved[first : places[0]] = True
    return moved


def mark_other_loads_of_passes(
    has_load: Bools,
    is_loaded: Bools,
    pass_of_manoeuvre: Ints,
    state: Ints,
    mass_kg: Floats,
    u_kg: Floats,
) -> Bools:
    """Mark manoeuvres whose load is not the one that defines their pass, (manoeuvres,).

    A loaded pass is defined by its last load, the one that is dumped, as the machine may spill or
    be filled up before. An empty pass is defined by its lightest load, as the machine may carry the
    rest of a load to another dump, or a part of the next load.

    Args:
        has_load: (manoeuvres,) whether the load of each is known and plausible; not while dumping.
        is_loaded: (manoeuvres,) whether each is loaded.
        pass_of_manoeuvre: (manoeuvres,) pass of each.
        state: (manoeuvres,) load state of each manoeuvre.
        mass_kg: (states,) mass of each state.
        u_kg: (states,) random uncertainty of each mass.
    """
    other = np.zeros(state.size, np.bool_)
    for number in np.unique(pass_of_manoeuvre[has_load]):
        inside = has_load & (pass_of_manoeuvre == number)
        of_pass = state[inside]
        kept = of_pass[-1] if is_loaded[inside][-1] else of_pass[np.argmin(mass_kg[of_pass])]
        apart_kg = LIMITS.other_load_std * np.hypot(u_kg[state], u_kg[kept])
        other |= inside & (np.abs(mass_kg[state] - mass_kg[kept]) > apart_kg)
    return other
