"""The route between where a machine is loaded and where it dumps, by how far it has driven.

A haul and the way back lead over the same ground, at other speeds: counted from the dump, what the
ground does at a place is the same with the load and without.
"""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples

#: Length of the route over the median haul: loads are not all taken at one place. An edge of the
#: ground at 2.4 to 3.2 m, where half the starts began, left loads a third too light without it.
_ROUTE_OVER_HAUL: Final = 1.2
#: A machine that brakes for the dump over more than so many times what is usual has left it since.
_LONGEST_STOP: Final = 2.0
#: A visit that nothing tells is looked for where cycles of like length would have it, within this
#: share of a cycle.
_PLACE_TOLERANCE: Final = 0.15


@dataclass(frozen=True, slots=True)
class Route:
    """Where loads are dumped, in m that the machine has driven since the log began.

    Attributes:
        dumps_m: (dumps,) ascending.
        length_m: from where it dumps to beyond where it is loaded.
    """

    dumps_m: Floats
    length_m: float

    @classmethod
    def of(cls, motion: MotionSamples, unit: Ints, loaded: Bools) -> Self | None:
        """Find the dumps; None where none is between two manoeuvres.

        Args:
            motion: the samples.
            unit: (units,) numbers of the manoeuvres, ascending.
            loaded: (units,) which of them haul.
        """
        last = motion.unit.size - 1
        begins_m = motion.driven_m[np.searchsorted(motion.unit, unit).clip(0, last)]
        ends_m = motion.driven_m[(np.searchsorted(motion.unit, unit, "right") - 1).clip(0, last)]
        fills_m = begins_m[1:][loaded[1:] & ~loaded[:-1]]
        dumps = ~loaded[1:] & loaded[:-1]
        if not dumps.any():
            return None
        dumps_m = _place_dumps(ends_m[:-1][dumps], begins_m[1:][dumps])
        before = np.searchsorted(fills_m, dumps_m) - 1
        if not (before >= 0).any():
            return None
        hauls_m = dumps_m[before >= 0] - fills_m[before[before >= 0]]
        length_m = max(_ROUTE_OVER_HAUL * float(np.median(hauls_m)), 1.0)
        return cls(add_missed_visits(dumps_m, begins_m), length_m)

    def position(self, motion: MotionSamples) -> Floats:
        """How far samples are from the nearest dump, (n,): 0 there, 1 where the route ends."""
        here = motion.driven_m
        ahead = np.append(self.dumps_m, np.inf)[np.searchsorted(self.dumps_m, here)] - here
        passed = np.searchsorted(self.dumps_m, here, "right")
        behind = here - np.append(-np.inf, self.dumps_m)[passed]
        return np.minimum(np.minimum(ahead, behind) / self.length_m, 1.0)


def _place_dumps(arrives_m: Floats, leaves_m: Floats) -> Floats:
    """Where the machine leaves empty; where it arrived, if that start is none of the fit's.

    Args:
        arrives_m: (dumps,) the end of the last manoeuvre with the load.
        leaves_m: (dumps,) the begin of the first without it.
    """
    stops_m = leaves_m - arrives_m
    usual_m = float(np.median(stops_m))
    return np.where(stops_m > _LONGEST_STOP * usual_m, arrives_m + usual_m, leaves_m)


def add_missed_visits(visits_m: Floats, begins_m: Floats) -> Floats:
    """Add visits where cycles as long as the others would have one: at the manoeuvre next to it.

    A load that is taken for none has no dump, and its starts would be anywhere on the route: they
    would stay unlike those of other loads.

    Args:
        visits_m: (visits,) of one place, in m that the machine has driven, ascending.
        begins_m: (units,) where its manoeuvres begin, likewise.
    """
    cycles_m = np.diff(visits_m)
    if not cycles_m.size:
        return visits_m
    cycle_m = float(np.median(cycles_m))
    number = np.round(cycles_m / cycle_m).astype(np.int64)
    # cycles that are each a little longer or shorter add up like chance
    regular = abs(cycles_m / cycle_m - number) < _PLACE_TOLERANCE * np.sqrt(number)
    regular &= number > 1
    expected_m = [
        visits_m[k] + cycles_m[k] * np.arange(1, number[k]) / number[k]
        for k in np.flatnonzero(regular)
    ]
    if not expected_m:
        return visits_m
    wanted_m = np.concatenate(expected_m)
    nearest_m = begins_m[abs(begins_m[:, None] - wanted_m).argmin(axis=0)]
    near = abs(nearest_m - wanted_m) < _PLACE_TOLERANCE * cycle_m
    return np.unique(np.append(visits_m, np.where(near, nearest_m, wanted_m)))
