"""The command `verify` for several bundles: verify each bundle, and each machine's chain."""

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from estimators.errors import format_count
from recordings.calibration.chain_check import check_chains_of_bundles
from recordings.calibration.check_outcomes import (
    BundleFinding,
    BundleOutcome,
    find_most_severe_outcome,
)
from recordings.calibration.checked_bundle import CheckedBundle
from replay.calibration.verify_bundle import Verification, verify_bundle


@dataclass(frozen=True, slots=True)
class VerifiedChain:
    """Result of verifying several bundles.

    Attributes:
        bundles: result of each bundle, in the given order.
        findings: errors in the chains.
        notes: a sentence on the signer of each bundle in a chain, in order of counters.
    """

    bundles: tuple[Verification, ...]
    findings: tuple[BundleFinding, ...]
    notes: tuple[str, ...]

    @property
    def outcome(self) -> BundleOutcome | None:
        """Worst outcome of all bundles, which is the exit status; None if nothing is wrong."""
        return find_most_severe_outcome(
            [*self.findings, *(each for made in self.bundles for each in made.findings)]
        )

    @property
    def chain_verdict(self) -> str:
        """The outcome for all bundles, as a sentence."""
        these = format_count(len(self.bundles), "bundle")
        if self.outcome is None:
            return f"{these}: each verified, with one chain for each machine"
        wrong = sum(len(made.findings) for made in self.bundles) + len(self.findings)
        kind = BundleFinding(self.outcome, "", "").kind
        return f"{these}: {kind.upper()} ({format_count(wrong, 'finding')})"

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "outcome": 0 if self.outcome is None else int(self.outcome),
            "bundles": [made.to_dict() for made in self.bundles],
            "chain": {
                "findings": [
                    {"kind": each.kind, "item": each.item, "what": each.what}
                    for each in self.findings
                ],
                "notes": list(self.notes),
            },
        }


def verify_bundles_and_chains(
    folders: Sequence[Path],
    *,
    log_folder: Path | None = None,
    key_file: Path | None = None,
    is_signature_required: bool = False,
    verification_day: dt.date | None = None,
    authority_certificates: Path | None = None,
) -> VerifiedChain:
    """Verify several bundles, and that each machine's bundles form one chain.

    Only the latest evidence of each machine must not have expired.

    Args:
        folders: the bundles, in any order.
        log_folder: as in `verify_bundle`, for each bundle.
        key_file: as in `verify_bundle`.
        is_signature_required: as in `verify_bundle`.
        verification_day: day on which the latest evidence of each machine must be valid.
        authority_certificates: as in `verify_bundle`.

    Raises:
        EvidenceError: a folder does not exist, or a key or certificate cannot be read.
    """
    made = [
        verify_bundle(
            folder,
            log_folder=log_folder,
            key_file=key_file,
            is_signature_required=is_signature_required,
            verification_day=verification_day,
            authority_certificates=authority_certificates,
        )
        for folder in folders
    ]
    by_machine: dict[str, list[CheckedBundle]] = {}
    for each in made:
        if each.checked.document is not None:
            machine = each.checked.document.campaign.machine.id
            by_machine.setdefault(machine, []).append(each.checked)
    findings: list[BundleFinding] = []
    notes: list[str] = []
    for bundles in by_machine.values():
        wrong, said = check_chains_of_bundles(bundles)
        findings += wrong
        notes += said
    last = {
        machine: max(map(_get_chain_counter_or_zero, bundles))
        for machine, bundles in by_machine.items()
    }
    return VerifiedChain(
        tuple(
            each if _is_latest_bundle_of_machine(each, last) else _drop_expiry_finding(each)
            for each in made
        ),
        tuple(findings),
        tuple(notes),
    )


def _get_chain_counter_or_zero(checked_bundle: CheckedBundle) -> int:
    return 0 if checked_bundle.document is None else checked_bundle.document.chain.counter


def _is_latest_bundle_of_machine(
    verification: Verification, latest_by_machine: Mapping[str, int]
) -> bool:
    """Whether a bundle is its machine's latest, or names no machine."""
    document = verification.checked.document
    return (
        document is None
        or document.chain.counter == latest_by_machine[document.campaign.machine.id]
    )


def _drop_expiry_finding(verification: Verification) -> Verification:
    """The verification without its finding on expiry."""
    kept = tuple(
        each for each in verification.findings if each.outcome is not BundleOutcome.EXPIRED
    )
    return replace(verification, findings=kept)
