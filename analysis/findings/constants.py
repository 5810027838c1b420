"""Constant forces: whether an offset, a tilt of the accelerometer or Coulomb friction makes them.

Standing tells what the force reads at rest, and the accelerometer beyond gravity by the pitch;
driving tells their sum C = F₀ - m e + F_c. Brakes may hold a force at rest that driving has not,
and ground may slope under a log without pitch, so what rests shows need not be what drives.
"""

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from analysis.findings.case import ACC, Case
from analysis.forces import longitudinal_force
from analysis.schema import values

#: Each cause more must explain so much (squared deviations) to be there.
_A_CAUSE: Final = 9.0
#: So many deviations a standing reading must be, and this size, to be one.
DEVIATIONS: Final = 5.0
LEAST_M_S2: Final = 0.01
LEAST_SHARE: Final = 0.004
#: One that pitch vouches for is there whether driving sees it or not.
_PITCH: Final = "pitch_rad"


@dataclass(frozen=True)
class Constants:
    """What stands and what drives.

    Attributes:
        rest_N: force at rest, and its deviation; NaN where it never stands.
        error_m_s2: of the accelerometer at rest, likewise.
        coulomb_N: friction against the motion, likewise.
        by_direction: whether starts both ways tell it.
        offset: whether the force at rest is there while it drives; None: the log cannot tell.
        tilt: likewise of the accelerometer's error.
        coulomb: likewise of the friction.
    """

    rest_N: tuple[float, float]
    error_m_s2: tuple[float, float]
    coulomb_N: tuple[float, float]
    by_direction: bool
    offset: bool | None
    tilt: bool | None
    coulomb: bool | None


def has_pitch(case: Case) -> bool:
    """Whether the log knows the slope."""
    return _PITCH in case.aligned.columns


def gravity(case: Case) -> np.typing.NDArray[np.float64]:
    """Gravity along x by the pitch, (n,) in m/s²; 0 where there is none."""
    if not has_pitch(case):
        return np.zeros(case.aligned.height)
    return case.machine.machine.gravity_m_s2 * np.sin(values(case.aligned, _PITCH))


def constants(case: Case) -> Constants:
    """Explain the constant force of driving by as few causes as do."""
    if "constants" not in case.kept:
        case.kept["constants"] = _explained(case)
    found = case.kept["constants"]
    assert isinstance(found, Constants)
    return found


def _explained(case: Case) -> Constants:
    rest, rest_std = case.level_of(longitudinal_force(case.aligned, case.machine.machine))
    error, error_std = np.nan, np.nan
    if ACC in case.aligned.columns:
        error, error_std = case.level_of(values(case.aligned, ACC) - gravity(case))
    fit = case.fit
    if fit is None:
        return Constants(
            (rest, rest_std), (error, error_std), (np.nan, np.nan), False, None, None, None
        )
    names = [term.name for term in fit.terms]
    found, stds = fit.posterior
    const, std = float(found[names.index("const")]), float(stds[names.index("const")])
    offset = abs(rest) > max(DEVIATIONS * rest_std, LEAST_SHARE * fit.motion.largest_force)
    tilt = abs(error) > max(DEVIATIONS * error_std, LEAST_M_S2) and fit.motion.by_accelerometer
    of_tilt = -fit.mass_kg * error
    if "direction" in names:
        place = names.index("direction")
        coulomb = float(found[place]), float(stds[place])
        way = 0.0
    else:
        way = float(np.median(fit.motion.direction[fit.motion.used]))
        coulomb = np.nan, np.nan
    # with a pitch an error of the accelerometer is one, and acts
    tilts = (False, True) if tilt and not has_pitch(case) else (tilt,)
    offsets = (False, True) if offset else (False,)
    frictions = (False, True) if way else (False,)
    cost: dict[tuple[bool, bool, bool], float] = {}
    for of in product(offsets, tilts, frictions):
        known = (
            rest * of[0] + of_tilt * of[1]
            if of[0] and of[1]
            else (rest if of[0] else of_tilt if of[1] else 0.0)
        )
        left = const - known
        if of[2]:
            left = min(left * way, 0.0)
        cost[of] = (left / std) ** 2 + _A_CAUSE * sum(of)
    best = min(cost, key=lambda each: cost[each])
    if way:
        known = (rest if best[0] else 0.0) + (of_tilt if best[1] else 0.0)
        coulomb = (const - known) * way, std
    said = [_said(cost, best, place) for place in range(3)]
    return Constants(
        (rest, rest_std), (error, error_std), coulomb, not way, said[0], said[1], said[2]
    )


def _said(
    cost: dict[tuple[bool, bool, bool], float], best: tuple[bool, bool, bool], place: int
) -> bool | None:
    """Whether a cause is in the best explanation; None where one without it is nearly as good."""
    others = [each for of, each in cost.items() if of[place] != best[place]]
    if others and min(others) - cost[best] < _A_CAUSE / 2.0:
        return None
    return best[place]
