"""Outcomes and findings of checking a bundle, with their exit status."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Final

from estimators.errors import format_count


class BundleOutcome(IntEnum):
    """Kind of a finding; the value is the exit status of `payscope verify`."""

    TAMPERED = 3
    IRREPRODUCIBLE = 4
    INCOMPLETE = 5
    OUTSIDE = 6
    EXPIRED = 7
    OTHER_VERSION = 8


#: Outcomes from the most severe on; the first that was found is the exit status.
ORDER: Final = (
    BundleOutcome.TAMPERED,
    BundleOutcome.INCOMPLETE,
    BundleOutcome.IRREPRODUCIBLE,
    BundleOutcome.OUTSIDE,
    BundleOutcome.EXPIRED,
    BundleOutcome.OTHER_VERSION,
)
#: Outcomes that invalidate evidence; with the other outcomes, it is valid.
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
    """An error in a bundle.

    Attributes:
        outcome: kind of the error.
        item: file, and the item in it.
        what: short description of the error.
    """

    outcome: BundleOutcome
    item: str
    what: str

    @property
    def kind(self) -> str:
        """Name of the outcome."""
        return _NAMES[self.outcome]

    def __str__(self) -> str:
        return f"{self.kind}: {self.item}: {self.what}"


def find_most_severe_outcome(findings: Sequence[BundleFinding]) -> BundleOutcome | None:
    """Find the outcome that is the exit status; None without findings."""
    found = {each.outcome for each in findings}
    return next((outcome for outcome in ORDER if outcome in found), None)


def format_bundle_verdict(
    bundle_name: Path, findings: Sequence[BundleFinding], text_without_findings: str
) -> str:
    """Format the result of a check as a sentence.

    Args:
        bundle_name: checked folder or file.
        findings: the findings.
        text_without_findings: text of the result if there are no findings.
    """
    outcome = find_most_severe_outcome(findings)
    if outcome is None:
        return f"{bundle_name}: {text_without_findings}"
    return f"{bundle_name}: {_NAMES[outcome].upper()} ({format_count(len(findings), 'finding')})"
