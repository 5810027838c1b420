"""Whether evidence follows that of its machine before it."""

import hashlib

from recordings.calibration.bundle_folder import EVIDENCE
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument


def check_chain(
    checked: CheckedBundle, document: EvidenceDocument, before: CheckedBundle | None
) -> None:
    """Whether this evidence follows that before it."""
    chain, item = document.chain, f"{EVIDENCE}: chain"
    link = chain.previous
    if chain.counter != (1 if link is None else link.counter + 1):
        checked.add(
            BundleOutcome.TAMPERED, f"{item}.counter", "does not follow that of the link before"
        )
    if before is None:
        if link is not None:
            checked.notes.append(
                f"chained to evidence {link.id} (number {link.counter}), which was not given: "
                "--previous checks it"
            )
        return
    last = before.document
    for each in before.faults:
        checked.add(each.outcome, f"the evidence before: {each.item}", each.what)
    if last is None:
        checked.add(BundleOutcome.INCOMPLETE, "the evidence before", "cannot be read")
        return
    if last.campaign.machine.id != document.campaign.machine.id:
        checked.add(BundleOutcome.TAMPERED, item, "the evidence before is of another machine")
    if chain.counter <= last.chain.counter:
        checked.add(
            BundleOutcome.TAMPERED,
            f"{item}.counter",
            f"is {chain.counter}, and that before it {last.chain.counter}: the counter only "
            "grows, so this is older",
        )
    elif link is None:
        checked.add(BundleOutcome.TAMPERED, item, "names no evidence before it, and there is some")
    elif link.id != last.id or link.sums_sha256 != hashlib.sha256(before.sums).hexdigest():
        checked.add(BundleOutcome.TAMPERED, f"{item}.previous", "is other evidence than that given")
    else:
        _check_as_found(checked, document, last)
        if document.kind == "check":
            _check_kept(checked, document, last)


def _check_kept(checked: CheckedBundle, document: EvidenceDocument, last: EvidenceDocument) -> None:
    """What a check takes over from the evidence that it is a check of."""
    for name in ("calibration", "expires", "machine", "learnt", "options"):
        if getattr(document, name) != getattr(last, name):
            what = "is not that of the evidence before, which it is a check of"
            checked.add(BundleOutcome.TAMPERED, f"{EVIDENCE}: {name}", what)


def _check_as_found(
    checked: CheckedBundle, document: EvidenceDocument, last: EvidenceDocument
) -> None:
    found, line = document.as_found, last.calibration
    wanted = None if line is None else (last.id, line.alpha_1, line.beta_kg)
    if (None if found is None else (found.evidence_id, found.alpha_1, found.beta_kg)) != wanted:
        checked.add(
            BundleOutcome.IRREPRODUCIBLE,
            f"{EVIDENCE}: as_found",
            "is not the line before it",
        )
