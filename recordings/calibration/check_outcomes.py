"""What a check of a bundle may find, and the exit status of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Final

from estimators.errors import counted


class BundleOutcome(IntEnum):
    """What is wrong; the value is the exit status of `payscope verify`."""

    TAMPERED = 3
    IRREPRODUCIBLE = 4
    INCOMPLETE = 5
    OUTSIDE = 6
    EXPIRED = 7
    OTHER_VERSION = 8


#: Which of several outcomes is the exit status: the first that was found.
ORDER: Final = (
    BundleOutcome.TAMPERED,
    BundleOutcome.INCOMPLETE,
    BundleOutcome.IRREPRODUCIBLE,
    BundleOutcome.OUTSIDE,
    BundleOutcome.EXPIRED,
    BundleOutcome.OTHER_VERSION,
)
#: Outcomes of evidence that does not hold; the others are of evidence that does.
FAULTS: Final = frozenset(
    {BundleOutcome.TAMPERED, BundleOutcome.INCOMPLETE, BundleOutcome.IRREPRODUCIBLE}
)
_NAMES: Final = {
    BundleOutcome.TAMPERED: "tampered",
    BundleOutcome.IRREPRODUCIBLE: "irreproducible",
    BundleOutcome.INCOMPLETE: "incomplete",
    BundleOutcome.OUTSIDE: "not within limits",
    BundleOutcome.EXPIRED: "expired",
    BundleOutcome.OTHER_VERSION: "made by another version",
}


@dataclass(frozen=True, slots=True)
class BundleFinding:
    """Something that is wrong with a bundle.

    Attributes:
        outcome: of which kind.
        item: the file, and the place in it.
        what: in a few words.
    """

    outcome: BundleOutcome
    item: str
    what: str

    @property
    def kind(self) -> str:
        """The outcome in words."""
        return _NAMES[self.outcome]

    def __str__(self) -> str:
        return f"{self.kind}: {self.item}: {self.what}"


def worst_outcome(findings: Sequence[BundleFinding]) -> BundleOutcome | None:
    """The outcome that is the exit status; None where nothing was found."""
    found = {each.outcome for each in findings}
    return next((outcome for outcome in ORDER if outcome in found), None)


def verdict_text(place: Path, findings: Sequence[BundleFinding], holds: str) -> str:
    """The outcome of a check in a sentence.

    Args:
        place: what was checked.
        findings: what was found.
        holds: what is said where that is nothing.
    """
    outcome = worst_outcome(findings)
    if outcome is None:
        return f"{place}: {holds}"
    return f"{place}: {_NAMES[outcome].upper()} ({counted(len(findings), 'finding')})"
