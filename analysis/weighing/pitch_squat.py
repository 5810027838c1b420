"""A body that squats as the pitch shows it: gravity that follows the acceleration."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.weighing.equation import Equation, Floats, Ints
from analysis.weighing.stretch_means import MEAN, means, without_line
from estimators.fit_loss import group_rows

#: Pitch and acceleration that correlate so well are a squat.
_TOGETHER: Final = 0.8
#: A squat that adds less than this share of the acceleration does not matter,
_LEAST_SQUAT: Final = 0.005
#: and fewer stretches do not tell it from hills.
_FEWEST_STRETCHES: Final = 6
#: A share counts from so many of its deviations on.
_COUNTS: Final = 3.5


@dataclass(frozen=True, slots=True)
class StretchSquats:
    """How the pitch's gravity follows the acceleration in each stretch.

    Attributes:
        first: (stretches,) its first sample.
        both: (stretches,) sum of products of gravity and acceleration.
        square: (stretches,) sum of squares of the acceleration.
        of_gravity: (stretches,) likewise of the gravity.
    """

    first: Ints
    both: Floats
    square: Floats
    of_gravity: Floats

    @property
    def correlation(self) -> float:
        """Of gravity and acceleration, over all stretches; 0 where one does not change."""
        square = float(self.square.sum() * self.of_gravity.sum())
        return float(self.both.sum()) / np.sqrt(square) if square else 0.0


def squat_of_stretches(gravity: Floats, motion: Equation) -> StretchSquats:
    """Compare them stretch by stretch, each without a constant and a slope.

    Args:
        gravity: (n,) by the pitch, in m/s².
        motion: the samples, with a pitch.
    """
    assert motion.without_gravity is not None
    found: list[tuple[int, float, float, float]] = []
    for part in group_rows(motion.group):
        if part.size >= 10 * MEAN:
            a, g = (without_line(means(x[part])) for x in (motion.without_gravity, gravity))
            found.append((int(part[0]), float(a @ g), float(a @ a), float(g @ g)))
    first, both, square, of_gravity = np.array(found).reshape(-1, 4).T
    return StretchSquats(first.astype(np.int64), both, square, of_gravity)


def pitch_squat(gravity: Floats, motion: Equation) -> tuple[float, float] | None:
    """By which share of the acceleration the pitch's gravity follows it; None where it does not.

    A body that squats pitches with every acceleration alike. On a hill that is always started on at
    the same place the pitch follows as well, but less closely.

    Returns:
        The share and its standard deviation, by stretches.
    """
    found = squat_of_stretches(gravity, motion)
    count, total = found.both.size, float(found.square.sum())
    if count < _FEWEST_STRETCHES or found.correlation < _TOGETHER:
        return None
    share = float(found.both.sum()) / total
    scatter = float(((found.both - share * found.square) ** 2).sum()) * count / (count - 1)
    std = float(np.sqrt(scatter)) / total
    return (share, std) if share > max(_LEAST_SQUAT, _COUNTS * std) else None
