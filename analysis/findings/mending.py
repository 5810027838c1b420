"""What mending a cause would do to the mass: the fit once more, of a motion that is mended.

One refit costs a fraction of a replay. What a replay would do besides (other windows accepted,
another mean) is in the uncertainty.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.findings.case import Case
from analysis.findings.cause import Change
from analysis.weighing.equation import Equation
from analysis.weighing.joint_fit import again
from analysis.weighing.kinematics import kinematics

#: Of the deviation by noise alone: what a replay accepts besides, and the mean that it takes.
_OF_REPLAY: Final = 0.5
_ROUNDS: Final = 3

Mend = Callable[[Equation], Equation]


def mended(case: Case, mend: Mend, relative_u: float = 0.0) -> Change | None:
    """Fit once more.

    Args:
        case: the log.
        mend: makes the motion as it would be.
        relative_u: standard uncertainty of what is mended, as a share of it.
    """
    fit, noise = case.fit, case.column_noise
    if fit is None or noise is None:
        return None
    priors = case.machine.settings.priors
    motion = mend(fit.motion)
    if not motion.used.any():
        return None
    wheels = kinematics(motion, noise, priors)
    begun = replace(fit, motion=motion, kinematics=wheels)
    other = again(begun, noise, priors, rounds=_ROUNDS)
    kg = other.mass_kg - fit.mass_kg
    if not np.isfinite(kg):
        return None
    of_noise = fit.parts_kg(fit.weights(fit.main))["noise"]
    return Change(kg, float(np.hypot(relative_u * kg, _OF_REPLAY * of_noise)))
