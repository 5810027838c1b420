"""Loads as the way of driving suggests them: hauls repeat, and a load changes where they stand.

Between two turns a machine that hauls drives the same way again and again, and stands at the same
places. A load is put on at one of them and taken off at another, or either at every visit of one.
"""

from itertools import combinations
from typing import Final

import numpy as np

from analysis.weighing.haul_route import add_missed_visits
from analysis.weighing.load_states import places, unit_of_each_sample
from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples, first_of_stretch
from estimators.joint.group_effects import HINTED

#: Two stands are at one place within this share of the usual way between turns: piles creep by a
#: tenth of a haul.
_SAME_PLACE: Final = 0.12
#: A place is where the machine stands at least once in so many runs between turns.
_RUNS_A_VISIT: Final = 8
#: A place has at least so many visits.
_FEWEST_VISITS: Final = 4
#: States of which so many manoeuvres go by the direction may be nothing else,
_BY_DIRECTION: Final = 0.9
#: unless a boom or digging hints at this share of their changes: nearly one of two.
_HINTED: Final = 0.4
#: Places that are combined: those with the most visits.
_MOST_PLACES: Final = 6


def hauling_patterns(motion: MotionSamples) -> list[Ints]:
    """The load states that the way of driving suggests, (units,) each, from 0 on in time.

    States that differ as forwards and reverse do are none, unless something else tells that loads
    change there: a machine that answers otherwise in reverse would have loads.
    """
    kind = places(motion)
    first = np.flatnonzero(motion.used)[first_of_stretch(unit_of_each_sample(motion))]
    forwards = motion.direction[first] > 0.0
    begins_m = motion.driven_m[first]
    visits = [
        np.isin(begins_m[1:], add_missed_visits(begins_m[1:][each], begins_m[1:]))
        for each in _find_visits(begins_m, forwards)
    ]
    changes = [each & (kind > 0) for each in visits]
    taking_turns = [_take_turns(on, off) for on, off in combinations(visits, 2)]
    changes += [np.diff(loaded) & (kind > 0) for loaded in taking_turns]
    return [
        np.append(0, np.cumsum(each))
        for each in changes
        if each.any() and (not _follows_direction(each, forwards) or _is_hinted(kind[each]))
    ]


def _find_visits(begins_m: Floats, forwards: Bools) -> list[Bools]:
    """When the machine stands at each of its places, (units - 1,) stands each.

    Stands are alike that come as far behind the last turn as others, as far before the next one,
    and between the same directions.

    Args:
        begins_m: (units,) how far the machine has driven before each manoeuvre.
        forwards: (units,) whether it goes forwards.
    """
    turns = np.flatnonzero(np.diff(forwards)) + 1
    if turns.size < 2:
        return []
    here_m, turns_m = begins_m[1:], begins_m[turns]
    bounds_m = np.concatenate(([np.nan], turns_m, [np.nan]))
    since_m = here_m - bounds_m[np.searchsorted(turns_m, here_m, "left")]
    until_m = bounds_m[np.searchsorted(turns_m, here_m, "right") + 1] - here_m
    between = 2 * forwards[:-1] + forwards[1:]
    near = between[:, None] == between
    tolerance_m = _SAME_PLACE * _medians_by_kind(since_m + until_m, between)
    for way_m in (since_m, until_m):
        # before the first turn and behind the last one the other way tells alone
        near &= ~(np.abs(way_m[:, None] - way_m) > tolerance_m)
    known = np.isfinite(since_m + until_m)
    left, found = np.ones(here_m.size, np.bool_), list[Bools]()
    fewest = max(_FEWEST_VISITS, turns.size / _RUNS_A_VISIT)
    for _ in range(_MOST_PLACES):
        alike = (near & left).sum(axis=1) * (left & known)
        most = int(np.argmax(alike))
        if alike[most] < fewest:
            break
        found.append(near[most] & left)
        left &= ~found[-1]
    return found


def _medians_by_kind(values: Floats, kind: Ints) -> Floats:
    """For each value the median of those of its kind that are known; NaN where none is."""
    medians = np.full(values.size, np.nan)
    for each in np.unique(kind):
        known = values[(kind == each) & np.isfinite(values)]
        if known.size:
            medians[kind == each] = np.median(known)
    return medians


def _take_turns(on: Bools, off: Bools) -> Bools:
    """Which manoeuvres have the load that is put on and taken off at these stands, (units,)."""
    stand = np.arange(1, on.size + 1)
    last_on = np.maximum.accumulate(np.where(on, stand, 0))
    last_off = np.maximum.accumulate(np.where(off, stand, 0))
    # before the first of either the load is what that one ends
    begins = bool(off[np.argmax(on | off)])
    none_yet = np.maximum(last_on, last_off) == 0
    return np.append(begins, np.where(none_yet, begins, last_on > last_off))


def _is_hinted(kind: Ints) -> bool:
    """Whether something besides the direction tells at least one change of each load."""
    return float((kind >= HINTED).mean()) >= _HINTED


def _follows_direction(changes: Bools, forwards: Bools) -> bool:
    """Whether states that take turns differ as forwards and reverse do."""
    alike = float(np.mean((np.append(0, np.cumsum(changes)) % 2 == 1) == forwards))
    return max(alike, 1.0 - alike) > _BY_DIRECTION
