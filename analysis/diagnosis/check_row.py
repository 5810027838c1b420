"""A check: a number computed from a log, its limits, and the consequence of failing."""

from collections.abc import Callable
from dataclasses import dataclass

from analysis.diagnosis.check_inputs import AxisMotion, CheckInputs
from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.model.verdict import Consequence, EvidenceSubject
from analysis.model.verdict_limits import VerdictLimits


def _is_always_applicable(_inputs: CheckInputs, _motion: AxisMotion) -> bool:
    return True


def _return_no_mass_change(_inputs: CheckInputs, _motion: AxisMotion) -> None:
    return None


def _return_empty_text(_inputs: CheckInputs, _motion: AxisMotion) -> str:
    return ""


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One check of a log.

    Attributes:
        name: name in the verdict.
        about: quantity that the check may withhold; it decides which motion is judged.
        number: computes the number; NaN if the log lacks the data.
        minimum: setting of `[settings.verdict]` that the number must reach, if any.
        maximum: setting of `[settings.verdict]` that the number must not exceed, if any.
        applies: whether the check applies to a log.
        optional: whether the check does not apply if it has no number.
        meaning: meaning of the number, in a sentence.
        subject_text: names the subject of the number, if it differs between logs; else "".
        consequence: consequence of failing.
        compute_mass_change_over_u: change of the answer, in standard uncertainties, without the
            samples or channel that the check names. Up to 1, failing withholds nothing and is only
            reported.
        remedy: setting or change that would correct the fault.
        own_remedy: remedy for the log in question, if it differs from `remedy`; else "".
    """

    name: str
    about: EvidenceSubject
    number: Callable[[CheckInputs, AxisMotion], float]
    meaning: str
    minimum: str | None = None
    maximum: str | None = None
    applies: Callable[[CheckInputs, AxisMotion], bool] = _is_always_applicable
    optional: bool = False
    subject_text: Callable[[CheckInputs, AxisMotion], str] = _return_empty_text
    consequence: Consequence = "withhold"
    compute_mass_change_over_u: Callable[[CheckInputs, AxisMotion], float | None] = (
        _return_no_mass_change
    )
    remedy: str = ""
    own_remedy: Callable[[CheckInputs, AxisMotion], str] = _return_empty_text

    def __post_init__(self) -> None:
        for limit in filter(None, (self.minimum, self.maximum)):
            if limit not in VerdictLimits.model_fields:
                raise ValueError(
                    f"check '{self.name}': no setting '{limit}'; add it to VerdictLimits in "
                    "analysis/model/verdict_limits.py"
                )

    def describe_measured_quantity(self, inputs: CheckInputs, motion: AxisMotion) -> str:
        """Meaning of the number and its subject, as text."""
        name = self.subject_text(inputs, motion)
        return f"{self.meaning} ({name})" if name else self.meaning

    def describe_remedy(self, inputs: CheckInputs, motion: AxisMotion) -> str:
        """Remedy in this log."""
        return self.own_remedy(inputs, motion) or self.remedy

    def decide_consequence(self, inputs: CheckInputs, motion: AxisMotion) -> Consequence:
        """Consequence of failing in this log, given how much the mass changes."""
        mass_change_over_u = self.compute_mass_change_over_u(inputs, motion)
        return (
            "tell"
            if mass_change_over_u is not None and mass_change_over_u <= LIMITS.harmless_change_u
            else self.consequence
        )
