"""Whether the statement of a bundle is about its files, and signed by whom it should be."""

import datetime as dt
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import EVIDENCE, STATEMENT, SUMS, BundleFile
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle, bytes_of, fault_without_name
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.calibration.write_bundle import predicate_of
from recordings.signatures.keyring import Keyring
from recordings.signatures.signed_by import SignedBy
from recordings.signatures.signing import (
    PREDICATE_TYPE,
    STATEMENT_TYPE,
    EnvelopeContent,
    PublicKey,
    parse_envelope,
)

_UNKNOWN_KEY: Final = (
    "{}: whoever made this folder may have made the key as well, and any name; get the key from "
    "the signer by another way, then give it with --key, or keep it: {}"
)


def check_signature(
    checked: CheckedBundle,
    held: Mapping[str, BundleFile],
    digests: Mapping[str, str],
    document: EvidenceDocument | None,
    key: PublicKey | None,
    keyring: Keyring,
) -> None:
    """Who signed, and whether it is these files.

    Args:
        checked: gets what is found, and whose signature it is.
        held: files of the bundle.
        digests: of those that are signed, by name.
        document: the evidence; None where it cannot be read.
        key: the key that the user gave, if any.
        keyring: the keys that the user keeps.
    """
    named = document.signer if document is not None else None
    if STATEMENT not in held:
        _add_unsigned(checked, document, key)
        return
    checked.signed_by = SignedBy("broken")
    try:
        signed = parse_envelope(bytes_of(held, STATEMENT), STATEMENT)
        stated = None if named is None else PublicKey.of_text(named.public_key)
    except EvidenceError as fault:
        checked.add(BundleOutcome.TAMPERED, STATEMENT, fault_without_name(STATEMENT, fault))
        return
    before = len(checked.findings)
    if document is not None:
        _check_signer(checked, signed, stated, document)
    if key is not None and not signed.by(key):
        checked.add(
            BundleOutcome.TAMPERED, STATEMENT, f"is not signed by the key {key.key_id[:12]}… given"
        )
    if key is None and stated is not None and not signed.by(stated):
        checked.add(BundleOutcome.TAMPERED, STATEMENT, "its signature is not by the key it names")
    _check_statement(checked, signed, held, digests, document)
    if len(checked.findings) == before and stated is not None and document is not None:
        _identify(checked, stated, document, key, keyring)


def _add_unsigned(
    checked: CheckedBundle, document: EvidenceDocument | None, key: PublicKey | None
) -> None:
    """What it means that there is no statement."""
    if document is not None and document.signer is not None:
        checked.add(
            BundleOutcome.INCOMPLETE, STATEMENT, "is missing, and evidence.json has a signer"
        )
    elif key is not None:
        checked.add(BundleOutcome.INCOMPLETE, STATEMENT, "is missing: unsigned, and --key is given")
    elif document is not None:
        checked.notes.append(
            "UNSIGNED: nobody vouches for this; whoever held the folder could have changed "
            "every number and every digest in it"
        )


def _identify(
    checked: CheckedBundle,
    stated: PublicKey,
    document: EvidenceDocument,
    key: PublicKey | None,
    keyring: Keyring,
) -> None:
    """Whose key it is, by the user's own knowledge."""
    claimed = "" if document.signer is None else document.signer.name
    known = keyring.find(stated.key_id)
    owner = "" if known is None else known.owner
    by = SignedBy("unknown", claimed, owner, stated.key_id, stated.text)
    if known is not None:
        made = dt.datetime.fromisoformat(document.made).date()
        fault = known.fault_on(made, checked.proven_day)
        if fault:
            checked.signed_by = by
            outcome = BundleOutcome.TAMPERED if known.revoked else BundleOutcome.INCOMPLETE
            checked.add(outcome, STATEMENT, f"the key of {owner}, {by.key_id[:12]}…, {fault}")
            return
    how = "given" if key is not None else "unknown" if known is None else "known"
    checked.signed_by = by = replace(by, how=how)
    if not by.trusted:
        checked.notes.append(_UNKNOWN_KEY.format(by, by.add_line))


def _check_signer(
    checked: CheckedBundle,
    signed: EnvelopeContent,
    stated: PublicKey | None,
    document: EvidenceDocument,
) -> None:
    """Whether envelope and evidence name one key."""
    if stated is None or document.signer is None:
        checked.add(
            BundleOutcome.TAMPERED, EVIDENCE, "signer: names nobody, and there is a signature"
        )
    elif not stated.key_id == document.signer.key_id == signed.key_id:
        checked.add(
            BundleOutcome.TAMPERED, EVIDENCE, "signer.key_id: is not that of the signature's key"
        )


def _check_statement(
    checked: CheckedBundle,
    signed: EnvelopeContent,
    held: Mapping[str, BundleFile],
    digests: Mapping[str, str],
    document: EvidenceDocument | None,
) -> None:
    """Whether the statement is about these files."""
    said = signed.statement
    if said.get("_type") != STATEMENT_TYPE or said.get("predicateType") != PREDICATE_TYPE:
        checked.add(BundleOutcome.TAMPERED, STATEMENT, "is a statement of another kind")
    wanted: dict[str, Any] = dict(digests)
    if SUMS in held:
        wanted[SUMS] = held[SUMS].sha256
    subjects = said.get("subject")
    found: dict[str, Any] = {}
    for each in subjects if isinstance(subjects, list) else []:
        if isinstance(each, dict) and isinstance(each.get("name"), str):
            found[each["name"]] = each.get("digest")
    for name in sorted(set(found) | set(wanted)):
        if name not in found:
            checked.add(BundleOutcome.TAMPERED, name, "was not there when the bundle was signed")
        elif name not in wanted:
            checked.add(
                BundleOutcome.INCOMPLETE, name, "is missing, and was there when it was signed"
            )
        elif found[name] != {"sha256": wanted[name]}:
            checked.add(BundleOutcome.TAMPERED, name, "is not the file that was signed")
    if document is not None and said.get("predicate") != predicate_of(document):
        checked.add(BundleOutcome.TAMPERED, STATEMENT, "is about other evidence than evidence.json")
