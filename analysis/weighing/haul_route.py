"""Haul routes: places of loading and dumping, and the loads that the driving pattern suggests.

A haul and the way back lead over the same ground at different speeds: at the same distance from the
dump, the ground has the same effect with the load and without.

Between two changes of direction a hauling machine drives the same path again and again, and stops
at the same places. A load is picked up at one of them and dumped at another, or alternately picked
up and dumped at one.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Literal, Self

import numpy as np

from analysis.weighing.fitted_stretches import cache_on_samples, mark_stretch_starts
from analysis.weighing.load_changes import (
    classify_load_change_evidence,
    find_manoeuvre_of_fitted_samples,
)
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples
from estimators.joint.unit_levels import HINTED


@dataclass(frozen=True, slots=True)
class HaulRoute:
    """Places where loads are dumped, as distances driven since the log began.

    Attributes:
        dump_positions_m: (dumps,) driven distance at each dump, ascending.
        length_m: length of the route, from the dump to beyond the loading place.
    """

    dump_positions_m: Floats
    length_m: float

    @classmethod
    def from_motion(
        cls, motion: MotionSamples, manoeuvre_numbers: Ints, loaded: Bools
    ) -> Self | None:
        """Find the dumps and the length of the route; None if the log has no haul.

        Args:
            motion: the samples.
            manoeuvre_numbers: (manoeuvres,) numbers of the manoeuvres, ascending.
            loaded: (manoeuvres,) whether each manoeuvre carries a load.
        """
        last = motion.manoeuvre_of_sample.size - 1
        begins_m = motion.driven_m[
            np.searchsorted(motion.manoeuvre_of_sample, manoeuvre_numbers).clip(0, last)
        ]
        ends_m = motion.driven_m[
            (np.searchsorted(motion.manoeuvre_of_sample, manoeuvre_numbers, "right") - 1).clip(
                0, last
            )
        ]
        fills_m = begins_m[1:][loaded[1:] & ~loaded[:-1]]
        dumps = ~loaded[1:] & loaded[:-1]
        if not dumps.any():
            return None
        dump_positions_m = find_dump_positions_m(ends_m[:-1][dumps], begins_m[1:][dumps])
        before = np.searchsorted(fills_m, dump_positions_m) - 1
        if not (before >= 0).any():
            return None
        hauls_m = dump_positions_m[before >= 0] - fills_m[before[before >= 0]]
        length_m = max(LIMITS.route_over_haul * float(np.median(hauls_m)), 1.0)
        return cls(add_missed_dump_visits(dump_positions_m, begins_m), length_m)

    def compute_relative_distances_to_dump(self, motion: MotionSamples) -> Floats:
        """Distance of each sample from the nearest dump in route lengths, (n,), at most 1."""
        ahead, behind = self._compute_distances_to_next_and_last_dump_m(motion)
        return np.minimum(np.minimum(ahead, behind) / self.length_m, 1.0)

    def compute_headings_from_dump(self, motion: MotionSamples) -> Floats:
        """Heading of each sample, (n,): 1 with the front away from the nearest dump, else -1."""
        ahead, behind = self._compute_distances_to_next_and_last_dump_m(motion)
        return np.where(behind < ahead, motion.direction, -motion.direction)

    def _compute_distances_to_next_and_last_dump_m(
        self, motion: MotionSamples
    ) -> tuple[Floats, Floats]:
        """Distances to the next and from the last dump, (n,) each in m; infinite without one."""
        here = motion.driven_m

        def repeat_between_dumps(each_m: Floats, side: Literal["left", "right"]) -> Floats:
            # both are ascending, and there are few dumps
            bounds = np.searchsorted(here, self.dump_positions_m, side)
            return np.repeat(each_m, np.diff(bounds, prepend=0, append=here.size))

        ahead = repeat_between_dumps(np.append(self.dump_positions_m, np.inf), "right") - here
        behind = here - repeat_between_dumps(np.append(-np.inf, self.dump_positions_m), "left")
        return ahead, behind


def find_dump_positions_m(arrival_positions_m: Floats, departure_positions_m: Floats) -> Floats:
    """Positions of the dumps: where the machine departs empty, (dumps,) in m.

    If the next fitted start is far from the arrival, the dump is the usual distance after it.

    Args:
        arrival_positions_m: (dumps,) end of the last manoeuvre with the load.
        departure_positions_m: (dumps,) start of the first manoeuvre without the load.
    """
    stops_m = departure_positions_m - arrival_positions_m
    usual_m = float(np.median(stops_m))
    return np.where(
        stops_m > LIMITS.dump_stop_ratio * usual_m,
        arrival_positions_m + usual_m,
        departure_positions_m,
    )


def add_missed_dump_visits(visit_positions_m: Floats, manoeuvre_starts_m: Floats) -> Floats:
    """Add the visits to a place that regular cycles imply, at the start of the nearest manoeuvre.

    A load that was not recognised has no dump, and the positions of its starts on the route would
    be wrong.

    Args:
        visit_positions_m: (visits,) driven distance at the known visits to one place, ascending.
        manoeuvre_starts_m: (manoeuvres,) driven distance at the start of each manoeuvre.
    """
    cycles_m = np.diff(visit_positions_m)
    if not cycles_m.size:
        return visit_positions_m
    cycle_m = float(np.median(cycles_m))
    number = np.round(cycles_m / cycle_m).astype(np.int64)
    # random differences between the cycles add up as a square root
    regular = abs(cycles_m / cycle_m - number) < LIMITS.visit_tolerance_cycles * np.sqrt(number)
    regular &= number > 1
    expected_m = [
        visit_positions_m[k] + cycles_m[k] * np.arange(1, number[k]) / number[k]
        for k in np.flatnonzero(regular)
    ]
    if not expected_m:
        return visit_positions_m
    wanted_m = np.concatenate(expected_m)
    nearest_m = manoeuvre_starts_m[abs(manoeuvre_starts_m[:, None] - wanted_m).argmin(axis=0)]
    near = abs(nearest_m - wanted_m) < LIMITS.visit_tolerance_cycles * cycle_m
    return np.unique(np.append(visit_positions_m, np.where(near, nearest_m, wanted_m)))


def propose_hauling_partitions(motion: MotionSamples) -> list[Ints]:
    """Partitions into load states that the driving pattern suggests, (manoeuvres,) each.

    A partition that only follows the driving direction is proposed only with other evidence of load
    changes; otherwise a machine with another force reading in reverse would get two loads.
    """
    kind = classify_load_change_evidence(motion)
    begins_m, forwards = _find_manoeuvre_starts_and_directions(motion)
    numbers = number_recurrent_stops(motion)
    visits = [
        np.isin(begins_m[1:], add_missed_dump_visits(begins_m[1:][numbers == each], begins_m[1:]))
        for each in range(1, numbers.max(initial=0) + 1)
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


@cache_on_samples
def number_recurrent_stops(motion: MotionSamples) -> Ints:
    """Number of the recurrent place at which each manoeuvre ends, (manoeuvres - 1,); 0 for none."""
    begins_m, forwards = _find_manoeuvre_starts_and_directions(motion)
    numbers = np.zeros(begins_m.size - 1, np.int64)
    for number, stands in enumerate(mark_standstills_at_recurrent_stops(begins_m, forwards), 1):
        numbers[stands] = number
    return numbers


def _find_manoeuvre_starts_and_directions(motion: MotionSamples) -> tuple[Floats, Bools]:
    """Driven distance at the start of each manoeuvre, (manoeuvres,), and whether it is forwards."""
    first = np.flatnonzero(motion.is_fittable)[
        mark_stretch_starts(find_manoeuvre_of_fitted_samples(motion))
    ]
    return motion.driven_m[first], motion.direction[first] > 0.0


def mark_standstills_at_recurrent_stops(
    start_positions_m: Floats, is_forward: Bools
) -> list[Bools]:
    """For each recurrent stop, flags (manoeuvres - 1,) of the standstills at it.

    Standstills are at the same place if the distances to the last and the next change of direction
    are equal, and the driving directions before and after are the same.

    Args:
        start_positions_m: (manoeuvres,) driven distance at the start of each manoeuvre.
        is_forward: (manoeuvres,) whether each manoeuvre goes forwards.
    """
    turns = np.flatnonzero(np.diff(is_forward)) + 1
    if turns.size < 2:
        return []
    here_m, turns_m = start_positions_m[1:], start_positions_m[turns]
    bounds_m = np.concatenate(([np.nan], turns_m, [np.nan]))
    since_m = here_m - bounds_m[np.searchsorted(turns_m, here_m, "left")]
    until_m = bounds_m[np.searchsorted(turns_m, here_m, "right") + 1] - here_m
    between = 2 * is_forward[:-1] + is_forward[1:]
    near = between[:, None] == between
    tolerance_m = LIMITS.same_place_1 * compute_medians_by_label(since_m + until_m, between)
    for way_m in (since_m, until_m):
        # before the first and after the last turn only the other distance is known
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
    """For each value, median of the finite values with the same label, (n,); NaN if none is."""
    medians = np.full(values.size, np.nan)
    for each in np.unique(labels):
        known = values[(labels == each) & np.isfinite(values)]
        if known.size:
            medians[labels == each] = np.median(known)
    return medians


def mark_loaded_manoeuvres(is_loading_stand: Bools, is_unloading_stand: Bools) -> Bools:
    """Flags of the manoeuvres between a loading and the next unloading stop, (manoeuvres,)."""
    stand = np.arange(1, is_loading_stand.size + 1)
    last_on = np.maximum.accumulate(np.where(is_loading_stand, stand, 0))
    last_off = np.maximum.accumulate(np.where(is_unloading_stand, stand, 0))
    # before the first stop of either kind the machine is loaded if that stop unloads it
    starts = bool(is_unloading_stand[np.argmax(is_loading_stand | is_unloading_stand)])
    none_yet = np.maximum(last_on, last_off) == 0
    return np.append(starts, np.where(none_yet, starts, last_on > last_off))


def _have_load_changes_strong_evidence(change_kinds: Ints) -> bool:
    """Whether boom, bucket or digging indicate enough of the load changes."""
    return float((change_kinds >= HINTED).mean()) >= LIMITS.hinted_change_fraction


def _do_states_only_follow_direction(has_load_change: Bools, is_forward: Bools) -> bool:
    """Whether alternating states only follow the driving direction."""
    alike = float(np.mean((np.append(0, np.cumsum(has_load_change)) % 2 == 1) == is_forward))
    return max(alike, 1.0 - alike) > LIMITS.direction_state_fraction
