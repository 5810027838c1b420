"""The one table of nuisance terms: what a real machine's force holds besides m a + b v.

Each has a column, a prior whose width scales with the machine, and a sentence. Prior means are 0.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.settings import PriorSettings
from analysis.weighing.equation import Equation, Floats


@dataclass(frozen=True)
class Moments:
    """The samples that are averaged to columns: (n,) each, at the shift that the lag has now.

    Attributes:
        acceleration: in m/s².
        speed: in m/s.
        ground_speed: the same without the slip that the wheels are known to have.
        force: in N, moved back by the lag.
        force_rate: its derivative where it is more than noise, in N/s.
        direction: of each manoeuvre.
        progress: from -1/2 to 1/2 over the log.
    """

    acceleration: Floats
    speed: Floats
    ground_speed: Floats
    force: Floats
    force_rate: Floats
    direction: Floats
    progress: Floats


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A term of the fit.

    Attributes:
        name: in frames, settings and answers.
        unit: of its parameter.
        column: computes what multiplies its parameter, (n,).
        width: the default standard deviation of its prior.
        meaning: what it stands for.
        shrinks: what would narrow it.
        by_speed: derivative of the column by the speed, whose noise it carries; None: none.
        by_force: likewise by the force.
        by_acceleration: likewise by the acceleration.
        applies: whether a log can have it.
    """

    name: str
    unit: str
    column: Callable[[Moments], Floats]
    width: Callable[[Equation, PriorSettings], float]
    meaning: str
    shrinks: str
    by_speed: Callable[[Moments], Floats] | None = None
    by_force: Callable[[Moments], Floats] | None = None
    by_acceleration: Callable[[Moments], Floats] | None = None
    applies: Callable[[Equation], bool] = lambda _: True


def const_width(motion: Equation, priors: PriorSettings) -> float:
    """Standard deviation of the constant force's prior, in N."""
    return float(
        np.hypot(
            priors.const_share * motion.largest_force, priors.const_weight_share * motion.weight
        )
    )


#: In the order of the fit's parameters; a fit has those that apply to its log.
NUISANCES: Final = (
    Nuisance(
        "const",
        "N",
        lambda m: np.ones_like(m.speed),
        const_width,
        "a constant force: offset of the force, tilt or bias of the accelerometer, slope; "
        "Coulomb friction where all driving is one way",
        "starts in both directions, or at different throttles",
    ),
    Nuisance(
        "lag",
        "s",
        lambda m: -m.force_rate,
        lambda _, s: s.lag_s,
        "how late the force is, against the motion",
        "sharper starts, or clocks that are synchronised",
    ),
    Nuisance(
        "lag_drift",
        "s",
        lambda m: -m.force_rate * m.progress,
        lambda _, s: s.lag_drift_s,
        "how much later the force becomes over the log: clocks that drift apart",
        "clocks that are synchronised",
    ),
    Nuisance(
        "slip",
        "s/m",
        lambda m: np.abs(m.ground_speed) * m.force,
        lambda e, s: s.wheel_slip / e.largest_speed,
        "longitudinal slip: friction of a wheel speed that is not the ground's",
        "an accelerometer beside the wheel speed, or starts at different throttles",
        by_speed=lambda m: np.sign(m.speed) * m.force,
        by_force=lambda m: np.abs(m.speed),
    ),
    Nuisance(
        "quadratic",
        "N·s²/m²",
        lambda m: m.speed * np.abs(m.speed),
        lambda e, s: s.quadratic_share * e.largest_force / e.largest_speed**2,
        "resistance that grows with the square of the speed",
        "cruising at several speeds",
        by_speed=lambda m: 2.0 * np.abs(m.speed),
    ),
    Nuisance(
        "direction",
        "N",
        lambda m: m.direction,
        lambda e, s: np.hypot(
            s.direction_share * e.largest_force, s.direction_weight_share * e.weight
        ),
        "Coulomb friction, where the log drives both ways",
        "starts at different throttles",
        applies=lambda e: e.both_ways,
    ),
    Nuisance(
        "load_transfer",
        "s²/m",
        lambda m: m.acceleration * m.force,
        lambda _, s: s.load_transfer_s2_m,
        "the measured wheels' share of the force changes with the acceleration",
        "force measured on all wheels, or starts at different throttles",
        by_force=lambda m: m.acceleration,
        by_acceleration=lambda m: m.force,
        applies=lambda e: e.force_share < 1.0,
    ),
)

#: What a check adds to see whether the force is linear in the acceleration; all but free.
CURVATURE: Final = Nuisance(
    "curvature",
    "N·s⁴/m²",
    lambda m: m.acceleration * np.abs(m.acceleration),
    lambda _, __: 1e9,
    "a force that is not linear in the acceleration",
    "force measured on all wheels; brakes that are seen whole",
    by_acceleration=lambda m: 2.0 * np.abs(m.acceleration),
)
