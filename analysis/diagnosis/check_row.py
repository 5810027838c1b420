"""A check: a number of a log, its limits, and the consequence of failing it."""

from collections.abc import Callable
from dataclasses import dataclass

from analysis.diagnosis.check_inputs import AxisMotion, CheckInputs
from analysis.diagnosis.excluded_stretches import MOVES_U
from analysis.model.verdict import Consequence, EvidenceSubject


def _applies_always(_: CheckInputs, __: AxisMotion) -> bool:
    return True


def _return_none(_: CheckInputs, __: AxisMotion) -> None:
    return None


def _return_empty_text(_: CheckInputs, __: AxisMotion) -> str:
    return ""


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One check.

    Attributes:
        name: in the verdict.
        about: what it may withhold, and so which motion it looks at.
        number: computes its number; NaN if the log has nothing to compute it from.
        minimum: the setting of `[settings.verdict]` that it must reach, if any.
        maximum: the one that it must not exceed.
        applies: whether this log has what it looks at.
        optional: whether it does not apply where it has no number.
        meaning: what the number says, in a sentence.
        names: names what the number is of, where that differs from log to log; else "".
        consequence: of failing,
        moved_u: where what the check names was left out or replaced: how far that moves the answer,
            in standard uncertainties. Up to one, failing withholds nothing and is told.
        remedy: the setting or change that would mend it.
    """

    name: str
    about: EvidenceSubject
    number: Callable[[CheckInputs, AxisMotion], float]
    meaning: str
    minimum: str | None = None
    maximum: str | None = None
    applies: Callable[[CheckInputs, AxisMotion], bool] = _applies_always
    optional: bool = False
    names: Callable[[CheckInputs, AxisMotion], str] = _return_empty_text
    consequence: Consequence = "withhold"
    moved_u: Callable[[CheckInputs, AxisMotion], float | None] = _return_none
    remedy: str = ""

    def describe_number(self, inputs: CheckInputs, motion: AxisMotion) -> str:
        """The meaning, and what the number is of."""
        name = self.names(inputs, motion)
        return f"{self.meaning} ({name})" if name else self.meaning

    def consequence_in_log(self, inputs: CheckInputs, motion: AxisMotion) -> Consequence:
        """Consequence of failing in this log, in proportion to the mass change it names."""
        moved_u = self.moved_u(inputs, motion)
        return "tell" if moved_u is not None and moved_u <= MOVES_U else self.consequence
