"""What a check of a bundle has found so far."""

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import BundleFile
from recordings.calibration.check_outcomes import FAULTS, BundleFinding, BundleOutcome
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.signatures.signed_by import SignedBy


@dataclass(slots=True)
class CheckedBundle:
    """What a check found.

    Attributes:
        findings: what is wrong.
        notes: what a reader should know besides.
        document: the evidence; None where it cannot be read.
        readings: frame `readings`, likewise.
        points: frame of the points, likewise.
        sums: the bytes of SHA256SUMS.
        signed_by: whose signature it is, as far as the reader can know.
        notarised_by: who keeps the list of logs that the campaign names; None where it names none.
        proven_day: the day by which a time stamp proves that the signature was there, if any.
    """

    findings: list[BundleFinding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    document: EvidenceDocument | None = None
    readings: pl.DataFrame | None = None
    points: pl.DataFrame | None = None
    sums: bytes = b""
    signed_by: SignedBy = field(default_factory=lambda: SignedBy("unsigned"))
    notarised_by: SignedBy | None = None
    proven_day: dt.date | None = None

    @property
    def faults(self) -> list[BundleFinding]:
        """What makes the evidence worth nothing, or less: not what it says of a good machine."""
        return [each for each in self.findings if each.outcome in FAULTS]

    def add(self, outcome: BundleOutcome, item: str, what: str) -> None:
        """Add a finding."""
        self.findings.append(BundleFinding(outcome, item, what))


def held_bytes(held: Mapping[str, BundleFile], name: str) -> bytes:
    """The bytes of a file that is held in memory."""
    data = held[name].data
    assert data is not None
    return data


def fault_without_name(name: str, fault: EvidenceError) -> str:
    """The fault without the name that the finding has already."""
    return str(fault).removeprefix(f"{name}: ")
