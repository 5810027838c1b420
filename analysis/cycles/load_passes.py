"""Passes: manoeuvres between two changes of load, and their mass.

A pass is a stretch of manoeuvres that are all loaded or all empty; states that differ by less than
loaded and empty do (spillage, a state split in two) are one pass.
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
    mark_manoeuvres_while_dumping,
)
from analysis.cycles.cycle_limits import LIMITS
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.weighing.fit_columns import mark_plausible_masses
from estimators.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class LoadPasses:
    """Passes in order of time.

    Attributes:
        membership: (manoeuvres,) pass of each manoeuvre.
        share: (manoeuvres,) weight in the pass's mass; the weights of a pass add up to 1.
        loaded: (passes,) whether each pass is loaded.
        mass_kg: (passes,) mass.
        u_kg: (passes,) random uncertainty of the mass, from noise and scatter of the manoeuvres.
        start_ns: (passes,) first fitted sample.
        end_ns: (passes,) last fitted sample.
        max_filling_pause_ns: longest pause between digging starts that fill the same bucket.
        dumps: dumps seen in the boom angle.
        drift_1: (passes,) relative drift of the empty machine's mass at each pass.
    """

    membership: Ints
    share: Floats
    loaded: Bools
    mass_kg: Floats
    u_kg: Floats
    start_ns: Ints
    end_ns: Ints
    max_filling_pause_ns: int = LIMITS.max_filling_pause_ns
    dumps: BoomDumps = NO_DUMPS
    drift_1: Floats | float = 0.0

    @property
    def drift_corrected_masses_kg(self) -> Floats:
        """(passes,) mass of each, were the gain of the force its mean over the log."""
        return self.mass_kg / (1.0 + self.drift_1)


#: Of a log whose loads cannot be told from empty passes.
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
    """Join manoeuvres to passes; None if loaded and empty cannot be distinguished.

    Args:
        loads: frame with the scatter.
        manoeuvres: frame with states and masses.
        digging: the frame `digging`; one separates empty before from loaded after.
        aligned: frame with the boom, if measured.
        excitation: frame with phases and speed.
        drift_1: (states,) drift of the empty machine's mass at each state, over its mean.
    """
    if manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count():
        return None
    level = manoeuvres["mass_kg"].to_numpy()
    std = manoeuvres["mass_std_kg"].to_numpy()
    state = manoeuvres["load_id"].to_numpy()
    begin, end = (manoeuvres[name].to_numpy() for name in ("start_t_ns", "end_t_ns"))
    scatter_kg = float(loads["scatter_kg"].fill_null(0.0).max() or 0.0)  # pyright: ignore[reportArgumentType]
    weight = 1.0 / (std**2 + scatter_kg**2)
    total = np.bincount(state, weight)
    mass_kg = np.bincount(state, weight * level) / total
    u_kg = 1.0 / np.sqrt(total)
    loaded = classify_loaded_states(mass_kg / (1.0 + drift_1), u_kg, state, (begin, end), digging)
    if loaded is None:
        return None
    of_state = loaded[state]
    dumps = NO_DUMPS
    if aligned is not None and excitation is not None:
        emptied = np.flatnonzero(of_state[:-1] & ~of_state[1:])
        # one who creeps to the dump may have emptied the bucket before the start ends
        known = [(int(begin[k]), int(begin[k + 1])) for k in emptied]
        dumps = find_boom_dumps(aligned, excitation, known)
        of_state = correct_loaded_flags_at_dumps(of_state, begin, end, digging, dumps)
    pause_ns = compute_max_filling_pause_ns(of_state, begin, end, digging)
    parts = np.diff(of_state) != 0
    parts[find_manoeuvres_after_refills(of_state, begin, end, digging, dumps, pause_ns)] = True
    if digging.height < LIMITS.digging_min_fraction * np.count_nonzero(parts & of_state[:-1]):
        parts[find_load_change_indices_at_dumps(of_state, begin, end, dumps)] = True
    hauls_nothing = mark_short_hauls(of_state, parts, begin, end, digging)
    of_state = of_state & ~hauls_nothing
    parts = (np.diff(of_state) != 0) | (parts & of_state[1:])
    of = np.cumsum(np.append(0, parts)).astype(np.int64)
    first = np.flatnonzero(np.append(True, np.diff(of) > 0))
    last = np.append(first[1:] - 1, of.size - 1)
    dumping = mark_manoeuvres_while_dumping(begin, end, dumps)
    spilled = mark_spilled_loads(of_state & ~dumping, of, state, mass_kg, u_kg)
    no_mass = dumping | spilled | hauls_nothing | ~mark_plausible_masses(mass_kg)[state]
    left = np.where(no_mass, 0.0, weight)
    # a pass that has no other keeps what it has
    weight = np.where(np.bincount(of, left)[of] > 0.0, left, weight)
    total = np.bincount(of, weight)
    # a pass ends before its machine dumps
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
        np.broadcast_to(drift_1, mass_kg.shape)[state[first]],
    )


def mark_short_hauls(
    is_loaded: Bools, is_border: Bools, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame
) -> Bools:
    """Mark very short hauls of a load without a filling, (manoeuvres,).

    A machine that backs out after a dump may look loaded: a short manoeuvre determines its mass
    poorly, and a lowered boom looks like a dump. Empty manoeuvres lie close on both sides of it;
    where they do not, the rest of a haul was not weighed.

    Args:
        is_loaded: (manoeuvres,) whether each is loaded.
        is_border: (manoeuvres - 1,) borders between passes.
        start_ns: (manoeuvres,) start of each.
        end_ns: (manoeuvres,) end of each.
        digging: the frame `digging`.
    """
    found = np.zeros(is_loaded.size, np.bool_)
    first = np.flatnonzero(np.append(True, is_border))
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
    """Largest time in ns between starts that fill the same bucket, shorter than a cycle."""
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
    """Borders before which a loaded machine digs again, so that it must have been empty in between.

    No start weighs the empty drive: it was too short, or not recorded. The boom shows a dump, or
    enough time passed.
    """
    found: list[int] = []
    last_ns = -max_filling_pause_ns
    for start, stop in digging.select("start_t_ns", "end_t_ns").sort("start_t_ns").iter_rows():
        after = int(np.searchsorted(start_ns, start, "left"))
        if 0 < after < is_loaded.size and is_loaded[after - 1] and is_loaded[after]:
            empties = np.flatnonzero(~is_loaded[:after])
            first = int(empties[-1]) + 1 if empties.size else 0
            since_ns = max(int(start_ns[first]), last_ns)
            dumped = bool(dumps.select_dumps(int(end_ns[after - 1]), start))
            # what drives while it is seen to dig is no haul
            if (start - since_ns > max_filling_pause_ns or dumped) and end_ns[after - 1] <= start:
                found.append(after - 1)
        last_ns = stop
    return found


def correct_loaded_flags_at_dumps(
    is_loaded: Bools, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame, dumps: BoomDumps
) -> Bools:
    """Whether each manoeuvre is loaded, (manoeuvres,), with dumps where the boom shows them.

    If masses place a dump a few manoeuvres away from the boom's, the manoeuvres in between change
    class.
    """
    at = [int(np.searchsorted(start_ns, each.bucket_emptied_ns)) for each in dumps.dumps]
    dug = np.unique(np.searchsorted(start_ns, digging["start_t_ns"].to_numpy()))
    moved = is_loaded.copy()
    for first in np.flatnonzero(is_loaded[:-1] & ~is_loaded[1:]) + 1:
        if dumps.select_dumps(int(end_ns[first - 1]), int(start_ns[first])):
            continue
        # from one filling to the next
        low = int(max(dug[dug < first], default=0))
        high = int(min(dug[dug >= first], default=is_loaded.size))
        places = [place for place in at if low < place < high]
        if len(places) == 1:
            moved[places[0] : first] = False
            moved[first : places[0]] = True
    return moved


def mark_spilled_loads(
    is_loaded: Bools, pass_of_manoeuvre: Ints, state: Ints, mass_kg: Floats, u_kg: Floats
) -> Bools:
    """Mark manoeuvres with a load that is spilled before the dump, (manoeuvres,).

    Args:
        is_loaded: (manoeuvres,) whether each is loaded and not dumping.
        pass_of_manoeuvre: (manoeuvres,) pass of each.
        state: (manoeuvres,) load state of each.
        mass_kg: (states,).
        u_kg: (states,).
    """
    spilled = np.zeros(pass_of_manoeuvre.size, np.bool_)
    for number in np.unique(pass_of_manoeuvre[is_loaded]):
        inside = is_loaded & (pass_of_manoeuvre == number)
        last = int(state[inside][-1])
        for each in np.unique(state[inside]):
            apart = float(np.hypot(u_kg[each], u_kg[last]))
            spilled |= (
                inside
                & (state == each)
                & bool(mass_kg[each] - mass_kg[last] > LIMITS.spilled_load_std * apart)
            )
    return spilled


def classify_loaded_states(
    mass_kg: Floats, u_kg: Floats, state: Ints, times_ns: tuple[Ints, Ints], digging: pl.DataFrame
) -> Bools | None:
    """Whether each state is loaded, (states,); None if undecidable.

    Args:
        mass_kg: (states,).
        u_kg: (states,) random uncertainty.
        state: (manoeuvres,) load state of each.
        times_ns: (manoeuvres,) starts, and ends.
        digging: the frame `digging`; one separates empty before from loaded after.
    """
    label = label_state_loaded_by_digging(mass_kg, u_kg, state, *times_ns, digging)
    possible = mark_plausible_masses(mass_kg)
    found = classify_loaded_by_threshold(mass_kg[possible], u_kg[possible], label[possible])
    # a mass that no machine has tells of no change of the load
    return None if found is None else found[(np.cumsum(possible) - 1).clip(0)]


def label_state_loaded_by_digging(
    mass_kg: Floats, u_kg: Floats, state: Ints, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame
) -> Ints:
    """Labels by digging starts, (states,): 0 if one follows, 1 if one precedes, else -1."""
    label = np.full(mass_kg.size, -1)
    for start, stop in digging.select("start_t_ns", "end_t_ns").iter_rows():
        before = int(np.searchsorted(end_ns, start, "right")) - 1
        after = int(np.searchsorted(start_ns, stop, "left"))
        if before < 0 or after >= state.size:
            continue
        empty, full = state[before], state[after]
        apart = float(np.hypot(u_kg[full], u_kg[empty]))
        # a bucket is no lighter for what it digs
        if empty != full and mass_kg[full] > mass_kg[empty] - LIMITS.not_dug_std * apart:
            label[empty], label[full] = 0, 1
    return label


def classify_loaded_by_threshold(mass_kg: Floats, u_kg: Floats, loaded_label: Ints) -> Bools | None:
    """Classify each state as loaded or not, (states,), by a mass border between two classes.

    If loads are smaller than the states' standard deviations, digging decides, or whether nearly
    every state is heavier or lighter than both neighbours.
    """
    if mass_kg.size < 2:
        return None
    told = (loaded_label == 0).any() and (loaded_label == 1).any()
    border = find_threshold_between_medians(mass_kg)
    light, heavy = mass_kg <= border, mass_kg > border
    if told:
        light, heavy = loaded_label == 0, loaded_label == 1
    a, b = float(np.median(mass_kg[light])), float(np.median(mass_kg[heavy]))
    least_kg = float(np.median(u_kg))
    spread_kg = robust_std(mass_kg[light], least_kg)
    parted = b - a > LIMITS.class_distance_std * max(
        least_kg, spread_kg if light.sum() >= LIMITS.own_spread_min_states else 0.0
    )
    if not parted:
        # a load that changes without digging is dumped
        loaded_label = loaded_label if told else label_state_loaded_by_alternation(mass_kg)
        light, heavy = loaded_label == 0, loaded_label == 1
        if not do_class_means_differ(mass_kg[light], mass_kg[heavy], least_kg):
            return None
        # a load between others that is not seen to be dug is told by its mass
        undug = (loaded_label < 0) & (mass_kg > (a + b) / 2.0)
        undug[[0, -1]] = False
        return heavy | undug
    low = max(spread_kg, LIMITS.min_empty_spread * (b - a))
    high = max(robust_std(mass_kg[heavy], least_kg), LIMITS.min_loaded_spread * (b - a))
    border = (a * high + b * low) / (low + high)
    return mass_kg > (fit_loaded_threshold_kg(mass_kg, loaded_label, border) if told else border)


def label_state_loaded_by_alternation(mass_kg: Floats) -> Ints:
    """1 if heavier than the state before, 0 if lighter, (states,); -1 if they do not alternate."""
    rises = np.diff(mass_kg) > 0.0
    turns = rises[1:] != rises[:-1]
    by_chance = 2.0 * turns.size / 3.0
    std = np.sqrt((16.0 * mass_kg.size - 29.0) / 90.0)
    least = min(
        LIMITS.alternating_min_fraction * turns.size, by_chance + LIMITS.alternating_std * std
    )
    if not turns.size or np.count_nonzero(turns) < least:
        return np.full(mass_kg.size, -1)
    return np.append(not rises[0], rises).astype(np.int64)


def do_class_means_differ(light_kg: Floats, heavy_kg: Floats, min_spread_kg: float) -> bool:
    """Whether the means of two classes differ, with enough states in each."""
    if min(light_kg.size, heavy_kg.size) < LIMITS.own_spread_min_states:
        return False
    variances = (robust_std(each, min_spread_kg) ** 2 / each.size for each in (light_kg, heavy_kg))
    return float(np.mean(heavy_kg) - np.mean(light_kg)) > LIMITS.digging_class_distance_std * float(
        np.sqrt(sum(variances))
    )


def fit_loaded_threshold_kg(mass_kg: Floats, loaded_label: Ints, initial_kg: float) -> float:
    """Mass in kg between empty and loaded that contradicts the fewest labels, (states,)."""
    order = np.sort(mass_kg)
    choices = np.append((order[1:] + order[:-1]) / 2.0, initial_kg)
    wrong = [int(np.sum(loaded_label == np.where(mass_kg > choice, 0, 1))) for choice in choices]
    best = choices[np.array(wrong) == min(wrong)]
    return float(best[np.argmin(np.abs(best - initial_kg))])


def robust_std(values: Floats, min_std: float) -> float:
    """Standard deviation from the median absolute deviation."""
    return max(STD_OF_MAD * float(np.median(np.abs(values - np.median(values)))), min_std)


def find_threshold_between_medians(values: Floats) -> float:
    """Border with the least sum of distances to the medians on both sides.

    With squared distances (Otsu 1979), two masses far above the others would be a class of their
    own.
    """
    order = np.sort(values)
    middles = (order[1:] + order[:-1]) / 2.0
    sums = [
        float(sum(np.abs(part - np.median(part)).sum() for part in (order[:k], order[k:])))
        for k in range(1, order.size)
    ]
    return float(middles[int(np.argmin(sums))])
