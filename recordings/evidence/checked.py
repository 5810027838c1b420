"""What a check of a bundle has found so far."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

from estimators.errors import EvidenceError
from recordings.evidence.document import EvidenceDocument
from recordings.evidence.findings import BundleFinding, BundleOutcome
from recordings.evidence.folder import BundleFile


@dataclass(slots=True)
class CheckedBundle:
    """What a check found.

    Attributes:
        findings: what is wrong.
        notes: what a reader should know besides.
        document: the evidence; None where it cannot be read.
        readings: frame `readings`, likewise.
        sums: the bytes of SHA256SUMS.
    """

    findings: list[BundleFinding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    document: EvidenceDocument | None = None
    readings: pl.DataFrame | None = None
    sums: bytes = b""

    def add(self, outcome: BundleOutcome, item: str, what: str) -> None:
        """Add a finding."""
        self.findings.append(BundleFinding(outcome, item, what))


def bytes_of(held: Mapping[str, BundleFile], name: str) -> bytes:
    """The bytes of a file that is held in memory."""
    data = held[name].data
    assert data is not None
    return data


def without(name: str, fault: EvidenceError) -> str:
    """The fault without the name that the finding has already."""
    return str(fault).removeprefix(f"{name}: ")
