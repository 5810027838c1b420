"""The route between loading and dumping, measured by the driven distance.

A haul and the way back lead over the same ground, at other speeds: counted from the dump, what the
ground does at a place is the same with the load and without.
"""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples


@dataclass(frozen=True, slots=True)
class Route:
    """Places where loads are dumped, as distances driven since the log began.

    Attributes:
        dumps_m: (dumps,) driven distance at each dump, ascending.
        length_m: length from the dump to beyond the loading place.
    """

    dumps_m: Floats
    length_m: float

    @classmethod
    def from_motion(
        cls, motion: MotionSamples, manoeuvre_numbers: Ints, loaded: Bools
    ) -> Self | None:
        """Find the dumps; None if there is none between two manoeuvres.

        Args:
            motion: the samples.
            manoeuvre_numbers: (manoeuvres,) numbers of the manoeuvres, ascending.
            loaded: (manoeuvres,) whether each manoeuvre carries a load.
        """
        last = motion.unit.size - 1
        begins_m = motion.driven_m[np.searchsorted(motion.unit, manoeuvre_numbers).clip(0, last)]
        ends_m = motion.driven_m[
            (np.searchsorted(motion.unit, manoeuvre_numbers, "right") - 1).clip(0, last)
        ]
        fills_m = begins_m[1:][loaded[1:] & ~loaded[:-1]]
        dumps = ~loaded[1:] & loaded[:-1]
        if not dumps.any():
            return None
        dumps_m = find_dump_positions_m(ends_m[:-1][dumps], begins_m[1:][dumps])
        before = np.searchsorted(fills_m, dumps_m) - 1
        if not (before >= 0).any():
            return None
        hauls_m = dumps_m[before >= 0] - fills_m[before[before >= 0]]
        length_m = max(LIMITS.route_over_haul * float(np.median(hauls_m)), 1.0)
        return cls(add_missed_dump_visits(dumps_m, begins_m), length_m)

    def compute_relative_distances_to_dump(self, motion: MotionSamples) -> Floats:
        """Distance of samples from the nearest dump over the route's length, (n,), at most 1."""
        ahead, behind = self._compute_distances_to_dumps_m(motion)
        return np.minimum(np.minimum(ahead, behind) / self.length_m, 1.0)

    def compute_headings_from_dump(self, motion: MotionSamples) -> Floats:
        """Heading of samples, (n,): 1 with the front away from the nearest dump, -1 towards it."""
        ahead, behind = self._compute_distances_to_dumps_m(motion)
        return np.where(behind < ahead, motion.direction, -motion.direction)

    def _compute_distances_to_dumps_m(self, motion: MotionSamples) -> tuple[Floats, Floats]:
        """Distances to the next dump and from the one before, (n,) each; infinite without one."""
        here = motion.driven_m

        def repeat_between_dumps(each_m: Floats, side: Literal["left", "right"]) -> Floats:
            # both ascend, and the dumps are few
            bounds = np.searchsorted(here, self.dumps_m, side)
            return np.repeat(each_m, np.diff(bounds, prepend=0, append=here.size))

        ahead = repeat_between_dumps(np.append(self.dumps_m, np.inf), "right") - here
        behind = here - repeat_between_dumps(np.append(-np.inf, self.dumps_m), "left")
        return ahead, behind


def find_dump_positions_m(arrival_positions_m: Floats, departure_positions_m: Floats) -> Floats:
    """Positions at which the machine leaves empty, or arrives if its next start is not fitted.

    Args:
        arrival_positions_m: (dumps,) end of the last manoeuvre with the load.
        departure_positions_m: (dumps,) begin of the first manoeuvre without it.
    """
    stops_m = departure_positions_m - arrival_positions_m
    usual_m = float(np.median(stops_m))
    return np.where(
        stops_m > LIMITS.dump_stop_ratio * usual_m,
        arrival_positions_m + usual_m,
        departure_positions_m,
    )


def add_missed_dump_visits(visit_positions_m: Floats, manoeuvre_begins_m: Floats) -> Floats:
    """Add a visit where the regular cycles imply one, at the nearest manoeuvre.

    A load that is not recognised has no dump, and its starts would lie anywhere on the route.

    Args:
        visit_positions_m: (visits,) known visits to one place, as driven distance, ascending.
        manoeuvre_begins_m: (units,) driven distance at the begin of the manoeuvres.
    """
    cycles_m = np.diff(visit_positions_m)
    if not cycles_m.size:
        return visit_positions_m
    cycle_m = float(np.median(cycles_m))
    number = np.round(cycles_m / cycle_m).astype(np.int64)
    # cycles that are each a little longer or shorter add up like chance
    regular = abs(cycles_m / cycle_m - number) < LIMITS.visit_tolerance_cycles * np.sqrt(number)
    regular &= number > 1
    expected_m = [
        visit_positions_m[k] + cycles_m[k] * np.arange(1, number[k]) / number[k]
        for k in np.flatnonzero(regular)
    ]
    if not expected_m:
        return visit_positions_m
    wanted_m = np.concatenate(expected_m)
    nearest_m = manoeuvre_begins_m[abs(manoeuvre_begins_m[:, None] - wanted_m).argmin(axis=0)]
    near = abs(nearest_m - wanted_m) < LIMITS.visit_tolerance_cycles * cycle_m
    return np.unique(np.append(visit_positions_m, np.where(near, nearest_m, wanted_m)))
