"""Loads suggested by the driving pattern: hauls repeat, and a load changes at fixed stops.

Between two turns a machine that hauls drives the same way again and again, and stands at the same
places. A load is put on at one of them and taken off at another, or either at every visit of one.
"""

from itertools import combinations

import numpy as np

from analysis.weighing.fitted_stretches import mark_stretch_starts
from analysis.weighing.haul_route import add_missed_dump_visits
from analysis.weighing.load_changes import (
    classify_load_change_evidence,
    find_manoeuvre_of_fitted_samples,
)
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples
from estimators.joint.group_effects import HINTED


def propose_hauling_partitions(motion: MotionSamples) -> list[Ints]:
    """Partitions into load states that the driving pattern suggests, (units,) each.

    States that only follow the driving direction count only if something else shows that loads
    change; a machine with another response in reverse would have loads otherwise.
    """
    kind = classify_load_change_evidence(motion)
    first = np.flatnonzero(motion.is_fittable)[
        mark_stretch_starts(find_manoeuvre_of_fitted_samples(motion))
    ]
    forwards = motion.direction[first] > 0.0
    begins_m = motion.driven_m[first]
    visits = [
        np.isin(begins_m[1:], add_missed_dump_visits(begins_m[1:][each], begins_m[1:]))
        for each in mark_standstills_at_recurrent_stops(begins_m, forwards)
    ]
    changes = [each & (kind > 0) for each in visits]
    taking_turns = [mark_loaded_manoeuvres(on, off) for on, off in combinations(visits, 2)]
    changes += [np.diff(loaded) & (kind > 0) for loaded in taking_turns]
    return [
        np.append(0, np.cumsum(each))
        for each in changes
        if each.any()
        and (
            not _do_states_only_follow_direction(each, forwards)
            or _have_load_changes_strong_evidence(kind[each])
        )
    ]


def mark_standstills_at_recurrent_stops(
    begin_positions_m: Floats, is_forward: Bools
) -> list[Bools]:
    """Visits to each recurrent stop, as flags (units - 1,) of the standstills.

    Stands are of one place if they are as far after the last turn and before the next one, between
    the same directions.

    Args:
        begin_positions_m: (units,) distance driven before each manoeuvre.
        is_forward: (units,) whether each manoeuvre goes forwards.
    """
    turns = np.flatnonzero(np.diff(is_forward)) + 1
    if turns.size < 2:
        return []
    here_m, turns_m = begin_positions_m[1:], begin_positions_m[turns]
    bounds_m = np.concatenate(([np.nan], turns_m, [np.nan]))
    since_m = here_m - bounds_m[np.searchsorted(turns_m, here_m, "left")]
    until_m = bounds_m[np.searchsorted(turns_m, here_m, "right") + 1] - here_m
    between = 2 * is_forward[:-1] + is_forward[1:]
    near = between[:, None] == between
    tolerance_m = LIMITS.same_place_1 * compute_medians_by_label(since_m + until_m, between)
    for way_m in (since_m, until_m):
        # before the first turn and behind the last one the other way tells alone
        near &= ~(np.abs(way_m[:, None] - way_m) > tolerance_m)
    known = np.isfinite(since_m + until_m)
    left, found = np.ones(here_m.size, np.bool_), list[Bools]()
    fewest = max(LIMITS.place_min_visits, turns.size / LIMITS.runs_per_visit)
    for _ in range(LIMITS.max_places):
        alike = (near & left).sum(axis=1) * (left & known)
        most = int(np.argmax(alike))
        if alike[most] < fewest:
            break
        found.append(near[most] & left)
        left &= ~found[-1]
    return found


def compute_medians_by_label(values: Floats, labels: Ints) -> Floats:
    """Median of the known values of the same kind, for each value, (n,); NaN if none is known."""
    medians = np.full(values.size, np.nan)
    for each in np.unique(labels):
        known = values[(labels == each) & np.isfinite(values)]
        if known.size:
            medians[labels == each] = np.median(known)
    return medians


def mark_loaded_manoeuvres(is_loading_stand: Bools, is_unloading_stand: Bools) -> Bools:
    """Manoeuvres between a loading stand and the next unloading stand, (units,)."""
    stand = np.arange(1, is_loading_stand.size + 1)
    last_on = np.maximum.accumulate(np.where(is_loading_stand, stand, 0))
    last_off = np.maximum.accumulate(np.where(is_unloading_stand, stand, 0))
    # before the first of either the load is what that one ends
    begins = bool(is_unloading_stand[np.argmax(is_loading_stand | is_unloading_stand)])
    none_yet = np.maximum(last_on, last_off) == 0
    return np.append(begins, np.where(none_yet, begins, last_on > last_off))


def _have_load_changes_strong_evidence(change_kinds: Ints) -> bool:
    """Whether each load has at least one change that is not only a change of direction."""
    return float((change_kinds >= HINTED).mean()) >= LIMITS.hinted_change_fraction


def _do_states_only_follow_direction(has_load_change: Bools, is_forward: Bools) -> bool:
    """Whether alternating states only follow the driving direction."""
    alike = float(np.mean((np.append(0, np.cumsum(has_load_change)) % 2 == 1) == is_forward))
    return max(alike, 1.0 - alike) > LIMITS.direction_state_fraction
