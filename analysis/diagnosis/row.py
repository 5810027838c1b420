"""What a check is: a number of a log, its limits, and what failing it leads to."""

from collections.abc import Callable
from dataclasses import dataclass

from analysis.check import About, Consequence
from analysis.diagnosis.evidence import Evidence, Motion


def _always(_: Evidence, __: Motion) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One check.

    Attributes:
        name: in the verdict.
        about: what it may withhold, and so which motion it looks at.
        number: computes its number; NaN where there is nothing to tell it from.
        minimum: the setting of `[settings.verdict]` that it must reach, if any.
        maximum: the one that it must not exceed.
        applies: whether this log has what it looks at.
        optional: whether it does not apply where it has no number.
        meaning: what the number says, in a sentence.
        consequence: of failing.
        remedy: the setting or change that would mend it.
    """

    name: str
    about: About
    number: Callable[[Evidence, Motion], float]
    meaning: str
    minimum: str | None = None
    maximum: str | None = None
    applies: Callable[[Evidence, Motion], bool] = _always
    optional: bool = False
    consequence: Consequence = "withhold"
    remedy: str = ""
