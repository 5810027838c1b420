"""Result of checking a bundle, to which each check adds."""

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
    """Result of checking a bundle.

    Attributes:
        findings: errors.
        notes: notes for the reader.
        document: the evidence; None if unreadable.
        readings: frame `readings`; None if unreadable.
        points: frame of the points; None if unreadable.
        sums: content of SHA256SUMS.
        signed_by: signer, as far as known.
        notarised_by: notary of the campaign's list; None without one.
        proven_day: day by which a time stamp proves the signature, if any.
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
    def evidence_faults(self) -> list[BundleFinding]:
        """Findings that invalidate the evidence itself, unlike expiry or exceeded limits."""
        return [each for each in self.findings if each.outcome in FAULTS]

    def add_finding(self, outcome: BundleOutcome, item_name: str, text: str) -> None:
        """Add a finding about an item."""
        self.findings.append(BundleFinding(outcome, item_name, text))


def require_content_in_memory(files: Mapping[str, BundleFile], name: str) -> bytes:
    """Return the content of a file of the bundle that was read into memory."""
    data = files[name].data
    assert data is not None
    return data


def remove_file_name_from_fault(name: str, fault: EvidenceError) -> str:
    """Remove from an error's text the file name, which the finding already has."""
    return str(fault).removeprefix(f"{name}: ")
