"""The route between where a machine is loaded and where it dumps, by how far it has driven.

A haul and the way back lead over the same ground, at other speeds: counted from the dump, what the
ground does at a place is the same with the load and without.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples


@dataclass(frozen=True, slots=True)
class Route:
    """Where loads are dumped, in m that the machine has driven since the log began.

    Attributes:
        dumps_m: (dumps,) ascending.
        haul_m: from where it is loaded to where it dumps: the median.
    """

    dumps_m: Floats
    haul_m: float

    @classmethod
    def of(cls, motion: MotionSamples, unit: Ints, loaded: Bools) -> Self | None:
        """Find the dumps; None where none is between two manoeuvres.

        Args:
            motion: the samples.
            unit: (units,) numbers of the manoeuvres, ascending.
            loaded: (units,) which of them haul.
        """
        begin = np.searchsorted(motion.unit, unit).clip(0, motion.unit.size - 1)
        begins_m = motion.driven_m[begin]
        fills_m = begins_m[1:][loaded[1:] & ~loaded[:-1]]
        dumps_m = begins_m[1:][~loaded[1:] & loaded[:-1]]
        before = np.searchsorted(fills_m, dumps_m) - 1
        if not (before >= 0).any():
            return None
        hauls_m = dumps_m[before >= 0] - fills_m[before[before >= 0]]
        return cls(dumps_m, max(float(np.median(hauls_m)), 1.0))

    def position(self, motion: MotionSamples, loaded: Bools) -> Floats:
        """How far samples are from the dump, (n,): 0 there, 1 where the machine is loaded.

        Args:
            motion: the samples.
            loaded: (n,) whether they haul: to the next dump, or from the last one.
        """
        here = motion.driven_m
        ahead = np.append(self.dumps_m, np.inf)[np.searchsorted(self.dumps_m, here)] - here
        passed = np.searchsorted(self.dumps_m, here, "right")
        behind = here - np.append(-np.inf, self.dumps_m)[passed]
        return np.minimum(np.where(loaded, ahead, behind) / self.haul_m, 1.0)
