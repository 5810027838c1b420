"""Check the folder of a bundle without trusting its maker or this program's earlier output.

The checks are that the files are the signed ones, that the signed statement covers them, and that
the required signer signed it.
"""

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from analysis.calibration.campaign.campaign_fit import POINTS as POINT_COLUMNS
from analysis.calibration.campaign.campaign_readings import READINGS as READING_COLUMNS
from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import (
    EVIDENCE,
    NOTARY,
    POINTS,
    READINGS,
    REPORT,
    REQUIRED,
    RUNS,
    STATEMENT,
    SUMS,
    TIMESTAMP,
    UNLISTED,
    BundleFile,
    list_bundle_files_and_faults,
    parse_sha256sums,
    read_bundle_file,
)
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.chain_check import (
    check_counter_of_chain_link,
    check_link_to_previous_evidence,
)
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import (
    CheckedBundle,
    remove_file_name_from_fault,
    require_content_in_memory,
)
from recordings.calibration.evidence_document import (
    EvidenceDocument,
    UnknownFormatError,
    parse_untrusted_evidence,
)
from recordings.calibration.notary_stretch import check_notary_list_range
from recordings.calibration.recomputation import compare_bundle_with_recomputed
from recordings.calibration.timestamp import check_bundle_timestamp
from recordings.calibration.untrusted_files import UntrustedTable, read_untrusted_tables
from recordings.calibration.write_bundle import make_signed_statement_predicate
from recordings.signatures.keyring import Keyring
from recordings.signatures.signed_by import SignedBy
from recordings.signatures.signing import (
    PREDICATE_TYPE,
    STATEMENT_TYPE,
    EnvelopeContent,
    PublicKey,
    parse_untrusted_envelope,
)

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

_UNKNOWN_KEY: Final = (
    "{}: whoever made this folder may have made up the key and the name as well; get the key "
    "from the signer through another channel, then give it with --key, or keep it: {}"
)


def check_bundle(
    folder: Path,
    known_key: PublicKey | None = None,
    previous_folder: Path | None = None,
    keyring: Keyring | None = None,
    timestamp_authorities: "Sequence[Certificate]" = (),
) -> CheckedBundle:
    """Check a bundle by itself: files, signature, chain and recomputation.

    Args:
        folder: the bundle; nothing in it is executed, no link is followed, nothing outside is read.
        known_key: public key of the required signer.
        previous_folder: the machine's previous evidence, which is checked as well.
        keyring: keys kept by the user; None for none.
        timestamp_authorities: root certificates of trusted time-stamp authorities.

    Raises:
        EvidenceError: the folder does not exist, or is not a bundle.
    """
    bundle = _check_bundle_alone(
        folder, known_key, keyring or Keyring(Path()), timestamp_authorities
    )
    document = bundle.document
    if document is not None:
        check_counter_of_chain_link(bundle, document)
        before = None
        if previous_folder is not None:
            # a time stamp is required of the evidence itself, but not of the previous evidence
            stamped = timestamp_authorities if (previous_folder / TIMESTAMP).is_file() else ()
            before = _check_bundle_alone(previous_folder, None, keyring or Keyring(Path()), stamped)
            by = before.signed_by
            if known_key is not None and by.how == "unknown" and by.key_id == known_key.key_id:
                before.signed_by = replace(by, how="given")
        check_link_to_previous_evidence(bundle, document, before)
    return bundle


def _check_bundle_alone(
    folder: Path,
    known_key: PublicKey | None,
    keyring: Keyring,
    timestamp_authorities: "Sequence[Certificate]",
) -> CheckedBundle:
    """Check a bundle without its previous evidence."""
    bundle = CheckedBundle()
    held = read_and_check_bundle_files(folder, bundle)
    if EVIDENCE not in held:
        return bundle
    digests = {name: each.sha256 for name, each in held.items() if name not in UNLISTED}
    try:
        document = parse_untrusted_evidence(require_content_in_memory(held, EVIDENCE), EVIDENCE)
    except EvidenceError as fault:
        strange = isinstance(fault, UnknownFormatError)
        outcome = BundleOutcome.OTHER_VERSION if strange else BundleOutcome.TAMPERED
        bundle.add_finding(outcome, EVIDENCE, remove_file_name_from_fault(EVIDENCE, fault))
        check_bundle_signature(bundle, held, digests, None, known_key, keyring)
        return bundle
    bundle.document = document
    check_bundle_timestamp(bundle, held, document, timestamp_authorities)
    check_bundle_signature(bundle, held, digests, document, known_key, keyring)
    _check_that_evidence_lists_recordings(bundle, document, digests)
    stretch = require_content_in_memory(held, NOTARY) if NOTARY in held else None
    check_notary_list_range(bundle, document, stretch, keyring)
    readings, points = check_and_read_evidence_tables(bundle, held, document)
    bundle.readings, bundle.points = readings, points
    if readings is not None:
        findings, notes = compare_bundle_with_recomputed(
            document, readings, points, held[REPORT].data if REPORT in held else None
        )
        bundle.findings += findings
        bundle.notes += notes
    return bundle


def read_and_check_bundle_files(folder: Path, bundle: CheckedBundle) -> dict[str, BundleFile]:
    """Read every file of a bundle, and compare it with SHA256SUMS.

    Args:
        folder: the bundle.
        bundle: receives the findings.

    Returns:
        The files that could be read, by name.
    """
    names, strange = list_bundle_files_and_faults(folder)
    for name, what in strange[: LIMITS.max_foreign_entries]:
        bundle.add_finding(BundleOutcome.TAMPERED, name, what)
    if len(strange) > LIMITS.max_foreign_entries:
        more = f"{len(strange) - LIMITS.max_foreign_entries} more entries"
        bundle.add_finding(BundleOutcome.TAMPERED, more, "do not belong to a bundle")
    held: dict[str, BundleFile] = {}
    for name in names:
        try:
            held[name] = read_bundle_file(folder, name)
        except EvidenceError as fault:
            bundle.add_finding(
                BundleOutcome.TAMPERED, name, remove_file_name_from_fault(name, fault)
            )
    for name in (*REQUIRED, SUMS):
        if name not in names:
            bundle.add_finding(BundleOutcome.INCOMPLETE, name, "is missing")
    if SUMS in held:
        bundle.sums = require_content_in_memory(held, SUMS)
        try:
            compare_files_with_sha256sums(bundle, names, held, parse_sha256sums(bundle.sums))
        except EvidenceError as fault:
            bundle.add_finding(
                BundleOutcome.TAMPERED, SUMS, remove_file_name_from_fault(SUMS, fault)
            )
    return held


def compare_files_with_sha256sums(
    bundle: CheckedBundle,
    names: list[str],
    files: Mapping[str, BundleFile],
    expected_digests: Mapping[str, str],
) -> None:
    """Add findings for files that are missing, altered or not listed in SHA256SUMS."""
    for name, digest in expected_digests.items():
        if name in files and files[name].sha256 != digest:
            bundle.add_finding(
                BundleOutcome.TAMPERED, name, f"is not the file whose digest {SUMS} has"
            )
        if name not in names and name not in REQUIRED:
            bundle.add_finding(
                BundleOutcome.INCOMPLETE, name, f"is missing, although {SUMS} lists it"
            )
    for name in sorted(set(files) - set(expected_digests) - set(UNLISTED)):
        bundle.add_finding(BundleOutcome.TAMPERED, name, f"is not listed in {SUMS}")


def _check_that_evidence_lists_recordings(
    bundle: CheckedBundle, document: EvidenceDocument, digests: Mapping[str, str]
) -> None:
    """Check that the bundle has exactly the recordings of runs that the evidence names."""
    named = {log.recording for log in document.logs if log.recording}
    for name in sorted(named - set(digests)):
        bundle.add_finding(
            BundleOutcome.INCOMPLETE, name, "is missing, although the evidence names it"
        )
    for name in sorted(digests):
        if name.startswith(f"{RUNS}/") and name not in named:
            bundle.add_finding(
                BundleOutcome.TAMPERED, name, "is a recording that the evidence does not name"
            )


def check_and_read_evidence_tables(
    bundle: CheckedBundle, files: Mapping[str, BundleFile], document: EvidenceDocument
) -> tuple[pl.DataFrame | None, pl.DataFrame | None]:
    """Read readings and points, None if missing or unreadable; add findings for what is wrong."""
    digests = {
        READINGS: document.tables.readings_sha256,
        POINTS: document.tables.points_sha256,
    }
    schemas = {READINGS: READING_COLUMNS, POINTS: POINT_COLUMNS}
    there = [name for name in (READINGS, POINTS) if name in files]
    for name in there:
        if files[name].sha256 != digests[name]:
            bundle.add_finding(
                BundleOutcome.TAMPERED, name, "is not the table whose digest evidence.json has"
            )
    asked = [
        UntrustedTable(require_content_in_memory(files, name), schemas[name]) for name in there
    ]
    found: dict[str, pl.DataFrame] = {}
    for name, table in zip(there, read_untrusted_tables(asked), strict=True):
        if isinstance(table, str):
            bundle.add_finding(BundleOutcome.TAMPERED, name, table)
        else:
            found[name] = table
    return found.get(READINGS), found.get(POINTS)


def check_bundle_signature(
    bundle: CheckedBundle,
    files: Mapping[str, BundleFile],
    digests: Mapping[str, str],
    document: EvidenceDocument | None,
    known_key: PublicKey | None,
    keyring: Keyring,
) -> None:
    """Check the signature, its signer, and that it covers these files.

    Args:
        bundle: receives the findings and the signer.
        files: files of the bundle.
        digests: digests of the signed files, by name.
        document: the evidence; None if it cannot be read.
        known_key: key given by the user, if any.
        keyring: keys kept by the user.
    """
    named = document.signer if document is not None else None
    if STATEMENT not in files:
        _add_unsigned_findings(bundle, document, known_key)
        return
    bundle.signed_by = SignedBy("broken")
    try:
        signed = parse_untrusted_envelope(require_content_in_memory(files, STATEMENT), STATEMENT)
        stated = None if named is None else PublicKey.from_base64_text(named.public_key)
    except EvidenceError as fault:
        bundle.add_finding(
            BundleOutcome.TAMPERED, STATEMENT, remove_file_name_from_fault(STATEMENT, fault)
        )
        return
    before = len(bundle.findings)
    if document is not None:
        _check_that_signer_is_stated(bundle, signed, stated, document)
    if known_key is not None and not signed.is_signed_by(known_key):
        bundle.add_finding(
            BundleOutcome.TAMPERED,
            STATEMENT,
            f"is not signed by the key {known_key.key_id[:12]}… given",
        )
    if known_key is None and stated is not None and not signed.is_signed_by(stated):
        bundle.add_finding(
            BundleOutcome.TAMPERED, STATEMENT, "its signature is not by the key it names"
        )
    _check_signed_digests(bundle, signed, files, digests, document)
    if len(bundle.findings) == before and stated is not None and document is not None:
        identify_bundle_signer(bundle, stated, document, known_key, keyring)


def _add_unsigned_findings(
    bundle: CheckedBundle, document: EvidenceDocument | None, known_key: PublicKey | None
) -> None:
    """Add the findings of a bundle that has no signed statement."""
    if document is not None and document.signer is not None:
        bundle.add_finding(
            BundleOutcome.INCOMPLETE, STATEMENT, "is missing, although evidence.json names a signer"
        )
    elif known_key is not None:
        bundle.add_finding(
            BundleOutcome.INCOMPLETE,
            STATEMENT,
            "is missing: the bundle is unsigned, but --key is given",
        )
    elif document is not None:
        bundle.notes.append(
            "UNSIGNED: nobody vouches for this; whoever held the folder could have changed "
            "every number and every digest in it"
        )


def identify_bundle_signer(
    bundle: CheckedBundle,
    stated_signer: PublicKey,
    document: EvidenceDocument,
    known_key: PublicKey | None,
    keyring: Keyring,
) -> None:
    """Identify the signer of a bundle by the given key and the user's keyring."""
    claimed = "" if document.signer is None else document.signer.name
    known = keyring.find_key_by_id_or_prefix(stated_signer.key_id)
    owner = "" if known is None else known.owner
    by = SignedBy("unknown", claimed, owner, stated_signer.key_id, stated_signer.base64_text)
    if known is not None:
        made = dt.datetime.fromisoformat(document.made).date()
        fault = known.explain_distrust(made, bundle.proven_day)
        if fault:
            bundle.signed_by = by
            outcome = BundleOutcome.TAMPERED if known.revoked else BundleOutcome.INCOMPLETE
            bundle.add_finding(
                outcome, STATEMENT, f"the key of {owner}, {by.key_id[:12]}…, {fault}"
            )
            return
    how = "given" if known_key is not None else "unknown" if known is None else "known"
    bundle.signed_by = by = replace(by, how=how)
    if not by.is_trusted:
        bundle.notes.append(_UNKNOWN_KEY.format(by, by.command_to_add_key))


def _check_that_signer_is_stated(
    bundle: CheckedBundle,
    envelope: EnvelopeContent,
    stated_signer: PublicKey | None,
    document: EvidenceDocument,
) -> None:
    """Check that evidence, envelope and signature state the same key."""
    if stated_signer is None or document.signer is None:
        bundle.add_finding(
            BundleOutcome.TAMPERED, EVIDENCE, "signer: names nobody, although there is a signature"
        )
    elif not stated_signer.key_id == document.signer.key_id == envelope.key_id:
        bundle.add_finding(
            BundleOutcome.TAMPERED, EVIDENCE, "signer.key_id: is not that of the signature's key"
        )


def _check_signed_digests(
    bundle: CheckedBundle,
    envelope: EnvelopeContent,
    files: Mapping[str, BundleFile],
    digests: Mapping[str, str],
    document: EvidenceDocument | None,
) -> None:
    """Check that the signed statement lists these files with these digests."""
    said = envelope.statement
    if said.get("_type") != STATEMENT_TYPE or said.get("predicateType") != PREDICATE_TYPE:
        bundle.add_finding(BundleOutcome.TAMPERED, STATEMENT, "is a statement of another kind")
    wanted: dict[str, Any] = dict(digests)
    if SUMS in files:
        wanted[SUMS] = files[SUMS].sha256
    subjects = said.get("subject")
    found: dict[str, Any] = {}
    for each in subjects if isinstance(subjects, list) else []:
        if isinstance(each, dict) and isinstance(each.get("name"), str):
            found[each["name"]] = each.get("digest")
    for name in sorted(set(found) | set(wanted)):
        if name not in found:
            bundle.add_finding(
                BundleOutcome.TAMPERED, name, "was not there when the bundle was signed"
            )
        elif name not in wanted:
            bundle.add_finding(
                BundleOutcome.INCOMPLETE,
                name,
                "is missing, although it was there when it was signed",
            )
        elif found[name] != {"sha256": wanted[name]}:
            bundle.add_finding(BundleOutcome.TAMPERED, name, "is not the file that was signed")
    if document is not None and said.get("predicate") != make_signed_statement_predicate(document):
        bundle.add_finding(
            BundleOutcome.TAMPERED, STATEMENT, "is about other evidence than evidence.json"
        )
