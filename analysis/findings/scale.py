"""A scale that is wrong: the machine's empty mass is all that tells it."""

from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS


def find_wrong_scale(inputs: FindingInputs) -> list[Symptom]:
    """The lightest load against the empty mass, in their standard uncertainty with the scale."""
    found = inputs.check_inputs.empty_mass
    if found is None or not found.tells:
        return []
    return [
        Symptom(abs(found.in_u) / LIMITS.wrong_scale_u, found.text, channel=inputs.force_channel)
    ]
