"""Checks of a log against limits, and the verdict that they give together."""

from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, Self

import polars as pl

from analysis.model.model_limits import LIMITS

#: Checks of the mass that find a force without a sign, which makes the yaw torque wrong as well.
_SIGNS: Final = frozenset({"opposing_share", "driving_share"})

EvidenceSubject = Literal["mass", "inertia"]
#: Name of the check that fails if the mass is too uncertain.
RELATIVE_U: Final = "relative_u"
#: Consequence of a failed check: the number is withheld, its uncertainty widened, the methods that
#: disagree withheld, or the reader told.
Consequence = Literal["withhold", "widen", "method", "tell"]


@dataclass(frozen=True, slots=True)
class Check:
    """One number of a log against its limits.

    Attributes:
        check: name of the check.
        about: quantity that the check may withhold.
        value: the number; None if it cannot be computed.
        minimum: smallest passing number; None without one.
        maximum: largest passing number; None without one.
        passed: whether it passed; None if it does not apply.
        meaning: meaning of the number, in a sentence.
        consequence: consequence of failing.
        remedy: setting or change that would correct the fault; "" if there is none.
    """

    check: str
    about: EvidenceSubject
    value: float | None
    minimum: float | None
    maximum: float | None
    passed: bool | None
    meaning: str
    consequence: Consequence = "withhold"
    remedy: str = ""

    @property
    def limit_text(self) -> str:
        """The limits as text: `≥ 0.5`, `≤ 0.25`, `0.5 … 2`."""
        bounds = [f"{bound:g}" for bound in (self.minimum, self.maximum) if bound is not None]
        mark = "" if len(bounds) == 2 else "≤ " if self.minimum is None else "≥ "
        return mark + " … ".join(bounds) if bounds else "–"

    @property
    def is_near_limit(self) -> bool:
        """Whether it passed near a limit; never for negative limits."""
        if not self.passed or self.value is None:
            return False
        above = (
            self.maximum is not None
            and self.value > LIMITS.near_limit_fraction * self.maximum > 0.0
        )
        below = (
            self.minimum is not None
            and 0.0 < LIMITS.near_limit_fraction * self.value < self.minimum
        )
        return above or below

    def to_dict(self) -> dict[str, Any]:
        """The check as JSON-compatible values: a row of the frame `verdict`."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict of all checks of a log."""

    checks: tuple[Check, ...] = ()

    @classmethod
    def from_frame(cls, verdict_frame: pl.DataFrame) -> Self:
        """Build the verdict from the frame `verdict`."""
        return cls(tuple(Check(**row) for row in verdict_frame.iter_rows(named=True)))

    @property
    def can_weigh(self) -> bool:
        """Whether no check of the mass failed."""
        return not self.list_withholding_checks("mass")

    @property
    def has_spins(self) -> bool:
        """Whether the log has spins that checks judge."""
        return any(check.about == "inertia" for check in self.checks)

    @property
    def can_estimate_inertia(self) -> bool:
        """Whether there are spins, none of their checks failed, and the force has a sign."""
        signless = any(check.check in _SIGNS for check in self.list_withholding_checks("mass"))
        return self.has_spins and not signless and not self.list_withholding_checks("inertia")

    @property
    def withholding_checks_beyond_limit(self) -> tuple[Check, ...]:
        """Withholding checks that failed because of their value, not for lack of data."""
        return tuple(
            check
            for check in self.checks
            if check.passed is False and check.consequence == "withhold" and check.value is not None
        )

    def list_withholding_checks(self, subject: EvidenceSubject) -> tuple[Check, ...]:
        """Failed checks that withhold the subject: the mass or the inertia."""
        return tuple(
            each
            for each in self.checks
            if each.about == subject and each.passed is False and each.consequence == "withhold"
        )

    @property
    def is_mass_too_uncertain(self) -> bool:
        """Whether the mass is withheld for its uncertainty, alone or among other reasons."""
        return any(each.check == RELATIVE_U for each in self.list_withholding_checks("mass"))

    @property
    def failed_checks_that_withhold_nothing(self) -> tuple[Check, ...]:
        """Checks that failed without withholding anything."""
        return tuple(
            each for each in self.checks if each.passed is False and each.consequence != "withhold"
        )

    @property
    def checks_near_limit(self) -> tuple[Check, ...]:
        """Checks that passed near a limit."""
        return tuple(each for each in self.checks if each.is_near_limit)

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "can_weigh": self.can_weigh,
            "tells_inertia": self.can_estimate_inertia,
            "checks": [check.to_dict() for check in self.checks],
        }
