"""Check that the evidence of a machine forms a chain without gaps and forks."""

import datetime as dt
import hashlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from recordings.calibration.bundle_folder import EVIDENCE
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.campaign_faults import parse_creation_time
from recordings.calibration.check_outcomes import BundleFinding, BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument


def check_counter_of_chain_link(checked_bundle: CheckedBundle, document: EvidenceDocument) -> None:
    """Check that the counter is one more than that of the link to the previous evidence."""
    link = document.chain.previous
    if document.chain.counter != (1 if link is None else link.counter + 1):
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED,
            f"{EVIDENCE}: chain.counter",
            "is not one more than the counter of the previous evidence",
        )


def check_link_to_previous_evidence(
    checked_bundle: CheckedBundle, document: EvidenceDocument, previous_bundle: CheckedBundle | None
) -> None:
    """Check that evidence links to its previous evidence, and agrees with it.

    Args:
        checked_bundle: receives the findings.
        document: the evidence.
        previous_bundle: the previous evidence, checked; None if not given.
    """
    chain, item = document.chain, f"{EVIDENCE}: chain"
    link = chain.previous
    if previous_bundle is None:
        if link is not None:
            checked_bundle.notes.append(
                f"chained to evidence {link.id} (number {link.counter}), which was not given; "
                "give it with --previous to check it"
            )
        return
    last = previous_bundle.document
    for each in previous_bundle.evidence_faults:
        checked_bundle.add_finding(each.outcome, f"the previous evidence: {each.item}", each.what)
    if last is None:
        checked_bundle.add_finding(
            BundleOutcome.INCOMPLETE, "the previous evidence", "cannot be read"
        )
        return
    checked_bundle.notes.append(
        f"the previous evidence, number {last.chain.counter}: {previous_bundle.signed_by}"
    )
    if last.campaign.machine.id != document.campaign.machine.id:
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED, item, "the previous evidence belongs to another machine"
        )
    if chain.counter <= last.chain.counter:
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED,
            f"{item}.counter",
            f"is {chain.counter}, but that of the previous evidence is {last.chain.counter}: the "
            "counter only grows, so this evidence is older",
        )
    elif link is None:
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED, item, "names no previous evidence, although one was given"
        )
    elif link.id != last.id or link.sums_sha256 != digest_evidence_for_chain_link(previous_bundle):
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED,
            f"{item}.previous",
            "is not the previous evidence that was given",
        )
    else:
        if parse_creation_time(document) < parse_creation_time(last) - dt.timedelta(
            seconds=LIMITS.clock_difference_s
        ):
            what = f"is before the previous evidence was made, {last.made}"
            checked_bundle.add_finding(BundleOutcome.TAMPERED, f"{EVIDENCE}: made", what)
        _check_line_as_found(checked_bundle, document, last)
        if document.kind == "check":
            _check_content_copied_by_mass_check(checked_bundle, document, last)


def digest_evidence_for_chain_link(bundle: CheckedBundle) -> str:
    """Compute the digest by which a link refers to evidence: SHA-256 of SHA256SUMS."""
    return hashlib.sha256(bundle.sums).hexdigest()


class ChainCheck(NamedTuple):
    """Findings on the chains of machines, and notes on their signers."""

    findings: list[BundleFinding]
    notes: list[str]


def check_chains_of_bundles(checked_bundles: Sequence[CheckedBundle]) -> ChainCheck:
    """Check several bundles of a machine as a chain.

    Args:
        checked_bundles: bundles checked by themselves, in any order; unreadable ones are skipped.

    Returns:
        Gaps, forks and wrong links; and a sentence on the signer of the evidence of each counter.
    """
    by_digest = {digest_evidence_for_chain_link(each): each for each in checked_bundles}
    known = [(each.document, each) for each in by_digest.values() if each.document is not None]
    ordered = sorted(known, key=lambda pair: (pair[0].chain.counter, pair[0].made, pair[0].id))
    found: list[BundleFinding] = []
    for (last, before), (document, bundle) in pairwise(ordered):
        number, after = last.chain.counter, document.chain.counter
        item = f"machine {document.campaign.machine.id}: number {after}"
        if after == number:
            what = (
                f"a fork: {last.id} of {last.made} ({before.signed_by}) and {document.id} of "
                f"{document.made} ({bundle.signed_by}) have the same number"
            )
            found.append(BundleFinding(BundleOutcome.TAMPERED, item, what))
        elif after == number + 1:
            link = CheckedBundle()
            check_link_to_previous_evidence(link, document, before)
            found += [
                BundleFinding(each.outcome, f"{item}: {each.item}", each.what)
                for each in link.findings
                if not each.item.startswith("the previous evidence")
            ]
        else:
            span = f"{number + 1}" if after == number + 2 else f"{number + 1} to {after - 1}"
            found.append(
                BundleFinding(
                    BundleOutcome.INCOMPLETE,
                    f"machine {document.campaign.machine.id}: number {span}",
                    f"is missing between {last.id} and {document.id}",
                )
            )
    return ChainCheck(found, list(_iter_chain_signer_sentences(ordered)))


def _iter_chain_signer_sentences(
    ordered_bundles: Sequence[tuple[EvidenceDocument, CheckedBundle]],
) -> Iterator[str]:
    """Yield sentences on the start of the chain, and on the signer of each bundle."""
    if not ordered_bundles:
        return
    machine, first = ordered_bundles[0][0].campaign.machine.id, ordered_bundles[0][0].chain
    if first.previous is not None:
        yield (
            f"machine {machine}: the chain given begins with number {first.counter}; earlier "
            "evidence was not given"
        )
    for document, bundle in ordered_bundles:
        yield (
            f"machine {machine}: number {document.chain.counter}, a {document.kind} of "
            f"{document.made}: {bundle.signed_by}"
        )


def _check_content_copied_by_mass_check(
    checked_bundle: CheckedBundle, document: EvidenceDocument, previous_evidence: EvidenceDocument
) -> None:
    """Check the parts that a single-mass check copies from the calibration."""
    for name in ("calibration", "expires", "machine", "learnt", "options"):
        if getattr(document, name) != getattr(previous_evidence, name):
            what = "is not that of the previous evidence, which it checks"
            checked_bundle.add_finding(BundleOutcome.TAMPERED, f"{EVIDENCE}: {name}", what)


def _check_line_as_found(
    checked_bundle: CheckedBundle, document: EvidenceDocument, previous_evidence: EvidenceDocument
) -> None:
    """Check that the as-found line is that of the previous evidence."""
    found, line = document.as_found, previous_evidence.calibration
    wanted = None if line is None else (previous_evidence.id, line.alpha_1, line.beta_kg)
    if (None if found is None else (found.evidence_id, found.alpha_1, found.beta_kg)) != wanted:
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE, f"{EVIDENCE}: as_found", "is not the previous line"
        )
