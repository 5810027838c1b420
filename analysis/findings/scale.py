"""A scale that is wrong: the machine's empty mass is all that tells it."""

from typing import Final

from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs

#: Standard uncertainties, with the scale's, that chance stays below.
_SURELY_U: Final = 3.0


def find_wrong_scale(inputs: FindingInputs) -> list[Symptom]:
    """The lightest load against the empty mass, in their standard uncertainty with the scale."""
    found = inputs.check_inputs.empty_mass
    if found is None or not found.tells:
        return []
    return [Symptom(abs(found.in_u) / _SURELY_U, found.text, channel=inputs.force_channel)]
