"""The terms of a force that depends on the place, on a short path that is driven to and fro.

A spring, a cable, a cam, or the weight of an arm: such a force goes with the acceleration, which is
largest at the ends of the path.
"""

from typing import Final

import numpy as np

from analysis.weighing.motion_samples import Equation, Floats
from analysis.weighing.nuisances import Nuisance

#: So many half waves such a force may have on the path.
_HALF_WAVES: Final = 8
#: What all of it is in the budget.
BY_PLACE: Final = "place"


def _spring(place_1: Floats) -> Floats:
    """A force in proportion to the place, 1 at the path's end."""
    return 2.0 * place_1


def _wave(place_1: Floats, half_waves: int) -> Floats:
    return np.cos(np.pi * half_waves * (place_1 + 0.5))


def _of_wave(half_waves: int) -> Nuisance:
    return Nuisance(
        f"place_{half_waves}",
        "N",
        lambda m: _wave(m.place_1, half_waves),
        lambda e, s: s.place_share * e.largest_force / half_waves,
        "a force that depends on the place on a short path: gravity, a cable, a cam",
        "strokes at different accelerations over the same path",
        applies=lambda e: e.on_a_bench,
        source=BY_PLACE,
    )


#: Behind the nuisances that every log may have.
PLACE: Final = (
    Nuisance(
        "spring",
        "N",
        lambda m: _spring(m.place_1),
        lambda e, s: s.place_share * e.largest_force,
        "a force in proportion to the place on a short path, at its ends: a spring, gravity",
        "strokes at different accelerations over the same path",
        applies=lambda e: e.on_a_bench,
        source=BY_PLACE,
    ),
    *map(_of_wave, range(1, _HALF_WAVES + 1)),
)


def place_force(motion: Equation, found_N: Floats) -> Floats:
    """The force on the path that the terms of `PLACE` were found to have, (n,) in N.

    Args:
        motion: where the machine is.
        found_N: (terms,) parameters.
    """
    waves = (_wave(motion.place_1, half_waves) for half_waves in range(1, _HALF_WAVES + 1))
    return found_N @ np.stack([_spring(motion.place_1), *waves])
