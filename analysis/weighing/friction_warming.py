"""Change of viscous friction over a log as the oil warms."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from analysis.weighing.weighing_limits import LIMITS
from estimators.arrays import Floats


@dataclass(frozen=True)
class WarmingShape:
    """Change of viscous friction over a log, as an orthogonal polynomial of time.

    Attributes:
        degree: degree of the polynomial; the log needs more manoeuvres than that.
        share: computes the polynomial (n,) from the progress (n,) over the log, -1/2 to 1/2.
        meaning: description in words.
    """

    degree: int
    share: Callable[[Floats], Floats]
    meaning: str


#: Shapes by name of the term. Oil warms as 1 - exp(-t): without the cubic, payloads of five starts
#: were 5 to 12 % off where friction fell by a quarter.
WARMING: Final[Mapping[str, WarmingShape]] = {
    "viscous_drift": WarmingShape(
        1, lambda x: x, "how much viscous friction changes over the log: oil that warms"
    ),
    "viscous_bend": WarmingShape(
        2,
        lambda x: x**2 - LIMITS.progress_mean_square,
        "curvature of the change of viscous friction: oil warms fast at first",
    ),
    "viscous_cubic": WarmingShape(
        3,
        lambda x: x * (x**2 - LIMITS.progress_cube_slope),
        "levelling-off of the change of viscous friction: warm oil stays warm",
    ),
}
