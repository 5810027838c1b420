"""Braking that is left out though the force sees it: a linear drive, a car that brakes by motor.

Where a machine is always about to brake, the gate leaves nothing. Whether the force sees the brakes
is asked of the samples themselves, gate or no gate: then braking tells the mass that driving tells.
"""

from typing import Final

import numpy as np

from analysis.diagnosis.check_inputs import CheckInputs
from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.fit_causes import relative_mass_u
from analysis.stages.estimation import fit_quality
from estimators.arrays import Bools

#: Braking takes a large part of the windows from this share on.
_REFUSED: Final = 0.5
#: Masses of driving and braking that are as near, as a share, are one. Brakes that are seen to
#: nine tenths put them six to ten hundredths apart.
_AGREE: Final = 0.04
#: Known to less than this share each, they are not compared.
_KNOWN: Final = 0.02


def find_unmodelled_braking(inputs: FindingInputs) -> list[Symptom]:
    """Braking that takes most windows, of a log that tells little, and that the force sees."""
    if (
        not inputs.machine.settings.gate.exclude_braking
        or relative_mass_u(inputs) < LIMITS.poor_answer_u
    ):
        return []
    reasons = inputs.check_inputs.gated["reason_x"].cast(str)
    told = int((reasons != "warming_up").sum())
    refused = float((reasons == "braking").sum()) / max(told, 1)
    ratio = _braking_over_driving(inputs.check_inputs)
    if not abs(ratio - 1.0) < _AGREE:
        return []
    return [
        Symptom(
            refused / _REFUSED,
            f"braking refuses {refused:.0%} of the windows, and tells {ratio:.1%} of the mass that "
            "driving tells: the force sees the brakes",
            channel=inputs.force_channel,
            setting="settings.gate.exclude_braking",
            value="false",
        )
    ]


def _braking_over_driving(evidence: CheckInputs) -> float:
    """The mass by all braking over that by all driving, no window refused; NaN: no telling."""
    motion = evidence.straight
    A = np.column_stack([motion.A[:, :2], np.sign(motion.speed)])
    driving = motion.known & evidence.is_phase("accelerating", "cruising")
    found = [_fit_mass(A, motion.f, of) for of in (driving, motion.braking)]
    if not all(std_kg < _KNOWN * abs(kg) for kg, std_kg in found):
        return float("nan")
    return found[1][0] / found[0][0]


def _fit_mass(A: np.ndarray, f: np.ndarray, of: Bools) -> tuple[float, float]:
    mass_kg, std_kg, _ = fit_quality.ungated_fit(A, f, of)
    return mass_kg, std_kg
