"""Constant forces: whether an offset, a tilt of the accelerometer or Coulomb friction makes them.

Standing tells what the force reads at rest, and the accelerometer beyond gravity by the pitch;
driving tells their sum C = F₀ - m e + F_c. Brakes may hold a force at rest that driving has not,
and ground may slope under a log without pitch, so what rests shows need not be what drives.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from analysis.findings.altered_motion import accelerated
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.findings.whitened_rows import Explained, force_system
from analysis.model.schema import values
from analysis.stages.motion.forces import longitudinal_force
from analysis.weighing.motion_samples import MotionSamples

#: Each cause more must explain so much (squared deviations) to be there.
_A_CAUSE: Final = 9.0
#: Rows so far apart, in s, are taken for independent where motions are compared.
INDEPENDENT_S: Final = 0.2
#: So many deviations a standing reading must be, and this size, to be one.
DEVIATIONS: Final = 5.0
LEAST_M_S2: Final = 0.004
LEAST_SHARE: Final = 0.002
#: Fewer rows tell nothing.
_FEWEST: Final = 30
#: One that pitch vouches for is there whether driving sees it or not.
_PITCH: Final = "pitch_rad"


@dataclass(frozen=True)
class Constants:
    """What stands and what drives.

    Attributes:
        rest_N: force at rest, and its deviation; NaN where it never stands.
        error_m_s2: of the accelerometer at rest, likewise.
        offset: whether the force at rest is there while it drives; None: the log cannot tell.
        tilt: likewise of the accelerometer's error.
        motion: without those of them that act.
    """

    rest_N: tuple[float, float]
    error_m_s2: tuple[float, float]
    offset: bool | None
    tilt: bool | None
    motion: MotionSamples | None


def has_pitch(case: FindingInputs) -> bool:
    """Whether the log knows the slope."""
    return _PITCH in case.aligned.columns


def gravity(case: FindingInputs) -> np.typing.NDArray[np.float64]:
    """Gravity along x by the pitch, (n,) in m/s²; 0 where there is none."""
    if not has_pitch(case):
        return np.zeros(case.aligned.height)
    if "gravity" not in case.kept:
        pitch = values(case.aligned, _PITCH)
        case.kept["gravity"] = case.machine.machine.gravity_m_s2 * np.sin(pitch)
    return case.kept["gravity"]  # type: ignore[return-value]


def constants(case: FindingInputs) -> Constants:
    """Explain the constant force of driving by as few causes as do."""
    if "constants" not in case.kept:
        case.kept["constants"] = _explained(case)
    found = case.kept["constants"]
    assert isinstance(found, Constants)
    return found


def _explained(case: FindingInputs) -> Constants:
    rest = case.level_of(longitudinal_force(case.aligned, case.machine.machine))
    error = np.nan, np.nan
    if ACC in case.aligned.columns:
        error = case.level_of(values(case.aligned, ACC) - gravity(case))
    fit, noise = case.fit, case.column_noise
    if fit is None or noise is None or not np.isfinite(fit.theta).all():
        return Constants(rest, error, None, None, None)
    motion = fit.motion
    offset = abs(rest[0]) > max(DEVIATIONS * rest[1], LEAST_SHARE * motion.largest_force)
    tilt = abs(error[0]) > max(DEVIATIONS * error[1], LEAST_M_S2) and motion.by_accelerometer
    # with a pitch an error of the accelerometer is one, and acts
    tilts = (False, True) if tilt and not has_pitch(case) else (bool(tilt),)
    offsets = (False, True) if offset else (False,)
    friction = "direction" if motion.both_ways else "const"
    way = 1.0 if motion.both_ways else float(np.median(motion.direction[motion.used]))
    mass_kg, viscous = case.mass_of_samples(motion), max(fit.viscous, 0.0)
    left: dict[tuple[bool, bool, bool], float] = {}
    variances: list[float] = []
    for acts, tilted in product(offsets, tilts):
        system = force_system(
            _without(motion, rest[0] * acts, error[0] * tilted), noise, mass_kg, viscous
        )
        if system.y.size < _FEWEST:
            return Constants(rest, error, None, None, None)
        own = Explained.of(system, ())
        variances.append(own.variance)
        left[acts, tilted, False] = own.square_left * own.variance
        square = own.square(friction)
        if square > 0.0 and own.product(friction) * way > 0.0:
            gain = own.product(friction) ** 2 / square
            left[acts, tilted, True] = (own.square_left - gain) * own.variance
    cost = {of: each / min(variances) + _A_CAUSE * sum(of) for of, each in left.items()}
    best = min(cost, key=lambda each: cost[each])
    of_rest, of_error = (rest[0] if best[0] else 0.0), (error[0] if best[1] else 0.0)
    return Constants(
        rest,
        error,
        _said(cost, best, 0),
        _said(cost, best, 1),
        _without(motion, of_rest, of_error),
    )


def _without(motion: MotionSamples, rest_N: float, error_m_s2: float) -> MotionSamples:
    if rest_N:
        motion = replace(motion, force=motion.force - rest_N)
    return accelerated(motion, lambda x: x - error_m_s2) if error_m_s2 else motion


def _said(
    cost: dict[tuple[bool, bool, bool], float], best: tuple[bool, bool, bool], place: int
) -> bool | None:
    """Whether a cause is in the best explanation; None where one without it is nearly as good."""
    others = [each for of, each in cost.items() if of[place] != best[place]]
    if others and min(others) - cost[best] < _A_CAUSE / 2.0:
        return None
    return best[place]
