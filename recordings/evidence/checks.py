"""Check the folder of a bundle, as whoever trusts neither its maker nor us would."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.calibration.campaign_fit import POINTS as POINT_COLUMNS
from analysis.calibration.readings import READINGS as READING_COLUMNS
from estimators.errors import EvidenceError
from recordings.evidence.bundle import predicate_of
from recordings.evidence.document import EvidenceDocument, document_of
from recordings.evidence.findings import BundleFinding, BundleOutcome
from recordings.evidence.folder import (
    EVIDENCE,
    POINTS,
    READINGS,
    REPORT,
    REQUIRED,
    RUNS,
    STATEMENT,
    SUMS,
    UNLISTED,
    BundleFile,
    listing,
    parse_sums,
    read_file,
)
from recordings.evidence.recomputed import recompute
from recordings.evidence.signing import PREDICATE_TYPE, STATEMENT_TYPE, PublicKey, Signed, opened
from recordings.evidence.tables import StrangeTable, read_tables

#: Of entries that are no bundle's.
_MOST_NAMED: Final = 20
_UNKNOWN_KEY: Final = (
    "no key was given: the signature only shows that whoever holds the key named in the bundle "
    "signed it; give the signer's public key with --key"
)


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


def check_bundle(
    folder: Path, key: PublicKey | None = None, previous: Path | None = None
) -> CheckedBundle:
    """Check everything that a bundle says by itself.

    Args:
        folder: the bundle; nothing in it is run, no link followed, nothing outside read.
        key: whose signature is asked for.
        previous: the machine's evidence before it, trusted to be genuine, if it is whole.

    Raises:
        EvidenceError: there is no such folder, or it is no bundle at all.
    """
    checked = _checked(folder, key)
    document = checked.document
    if document is not None:
        _check_chain(checked, document, None if previous is None else _trusted(previous))
    return checked


def _trusted(folder: Path) -> CheckedBundle:
    """Evidence that is trusted to be genuine: whether it is whole, and what it is."""
    checked = CheckedBundle()
    held = _files(folder, checked)
    if EVIDENCE in held:
        try:
            checked.document = document_of(_data(held, EVIDENCE), EVIDENCE)
        except EvidenceError as fault:
            checked.add(BundleOutcome.TAMPERED, EVIDENCE, _without(EVIDENCE, fault))
    return checked


def _checked(folder: Path, key: PublicKey | None) -> CheckedBundle:
    """Check a bundle, without the one before it."""
    checked = CheckedBundle()
    held = _files(folder, checked)
    if EVIDENCE not in held:
        return checked
    digests = {name: each.sha256 for name, each in held.items() if name not in UNLISTED}
    try:
        document = document_of(_data(held, EVIDENCE), EVIDENCE)
    except EvidenceError as fault:
        checked.add(BundleOutcome.TAMPERED, EVIDENCE, _without(EVIDENCE, fault))
        _check_signature(checked, held, digests, None, key)
        return checked
    checked.document = document
    _check_signature(checked, held, digests, document, key)
    _check_recordings(checked, document, digests)
    readings, points = _tables(checked, held, document)
    checked.readings = readings
    if readings is not None:
        findings, notes = recompute(document, readings, points, _report(held))
        checked.findings += findings
        checked.notes += notes
    return checked


def _files(folder: Path, checked: CheckedBundle) -> dict[str, BundleFile]:
    """Every file that a bundle may hold, against SHA256SUMS."""
    names, strange = listing(folder)
    for name, what in strange[:_MOST_NAMED]:
        checked.add(BundleOutcome.TAMPERED, name, what)
    if len(strange) > _MOST_NAMED:
        more = f"{len(strange) - _MOST_NAMED} entries more"
        checked.add(BundleOutcome.TAMPERED, more, "are no bundle's")
    held: dict[str, BundleFile] = {}
    for name in names:
        try:
            held[name] = read_file(folder, name)
        except EvidenceError as fault:
            checked.add(BundleOutcome.TAMPERED, name, _without(name, fault))
    for name in (*REQUIRED, SUMS):
        if name not in names:
            checked.add(BundleOutcome.INCOMPLETE, name, "is missing")
    if SUMS in held:
        checked.sums = _data(held, SUMS)
        try:
            _check_sums(checked, names, held, parse_sums(checked.sums))
        except EvidenceError as fault:
            checked.add(BundleOutcome.TAMPERED, SUMS, _without(SUMS, fault))
    return held


def _check_sums(
    checked: CheckedBundle,
    names: list[str],
    held: Mapping[str, BundleFile],
    listed: Mapping[str, str],
) -> None:
    for name, digest in listed.items():
        if name in held and held[name].sha256 != digest:
            checked.add(BundleOutcome.TAMPERED, name, f"is not the file whose digest {SUMS} has")
        if name not in names and name not in REQUIRED:
            checked.add(BundleOutcome.INCOMPLETE, name, f"is missing, and {SUMS} lists it")
    for name in sorted(set(held) - set(listed) - set(UNLISTED)):
        checked.add(BundleOutcome.TAMPERED, name, f"is not listed in {SUMS}")


def _check_signature(
    checked: CheckedBundle,
    held: Mapping[str, BundleFile],
    digests: Mapping[str, str],
    document: EvidenceDocument | None,
    key: PublicKey | None,
) -> None:
    """Who signed, and whether it is these files."""
    named = document.signer if document is not None else None
    if STATEMENT not in held:
        if named is not None:
            checked.add(
                BundleOutcome.INCOMPLETE, STATEMENT, "is missing, and evidence.json has a signer"
            )
        elif key is not None:
            checked.add(
                BundleOutcome.INCOMPLETE, STATEMENT, "is missing: unsigned, and --key is given"
            )
        elif document is not None:
            checked.notes.append(
                "UNSIGNED: nobody vouches for this; whoever held the folder could have changed "
                "every number and every digest in it"
            )
        return
    try:
        signed = opened(_data(held, STATEMENT), STATEMENT)
        stated = None if named is None else PublicKey.of_text(named.public_key)
    except EvidenceError as fault:
        checked.add(BundleOutcome.TAMPERED, STATEMENT, _without(STATEMENT, fault))
        return
    if document is not None:
        _check_signer(checked, signed, stated, document)
    if key is not None and not signed.by(key):
        checked.add(
            BundleOutcome.TAMPERED, STATEMENT, f"is not signed by the key {key.key_id[:12]}… given"
        )
    if key is None:
        checked.notes.append(_UNKNOWN_KEY)
        if stated is not None and not signed.by(stated):
            checked.add(
                BundleOutcome.TAMPERED, STATEMENT, "its signature is not by the key it names"
            )
    _check_statement(checked, signed, held, digests, document)


def _check_signer(
    checked: CheckedBundle, signed: Signed, stated: PublicKey | None, document: EvidenceDocument
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
    signed: Signed,
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


def _check_recordings(
    checked: CheckedBundle, document: EvidenceDocument, digests: Mapping[str, str]
) -> None:
    """Whether the recordings of runs are those that the evidence names."""
    named = {log.recording for log in document.logs if log.recording}
    for name in sorted(named - set(digests)):
        checked.add(BundleOutcome.INCOMPLETE, name, "is missing, and the evidence names it")
    for name in sorted(digests):
        if name.startswith(f"{RUNS}/") and name not in named:
            checked.add(
                BundleOutcome.TAMPERED, name, "is a recording that the evidence does not name"
            )


def _tables(
    checked: CheckedBundle, held: Mapping[str, BundleFile], document: EvidenceDocument
) -> tuple[pl.DataFrame | None, pl.DataFrame | None]:
    """Readings and points; None of what cannot be read."""
    digests = {
        READINGS: document.tables.readings_sha256,
        POINTS: document.tables.points_sha256,
    }
    schemas = {READINGS: READING_COLUMNS, POINTS: POINT_COLUMNS}
    there = [name for name in (READINGS, POINTS) if name in held]
    for name in there:
        if held[name].sha256 != digests[name]:
            checked.add(
                BundleOutcome.TAMPERED, name, "is not the table whose digest evidence.json has"
            )
    asked = [StrangeTable(_data(held, name), schemas[name]) for name in there]
    found: dict[str, pl.DataFrame] = {}
    for name, table in zip(there, read_tables(asked), strict=True):
        if isinstance(table, str):
            checked.add(BundleOutcome.TAMPERED, name, table)
        else:
            found[name] = table
    return found.get(READINGS), found.get(POINTS)


def _check_chain(
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
    for each in before.findings:
        if each.outcome is not BundleOutcome.OUTSIDE:
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
        kept = (document.calibration, document.expires)
        if document.kind == "check" and kept != (last.calibration, last.expires):
            what = "line and last day are not those of the evidence before, which it is a check of"
            checked.add(BundleOutcome.TAMPERED, f"{EVIDENCE}: calibration", what)


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


def _report(held: Mapping[str, BundleFile]) -> bytes | None:
    return held[REPORT].data if REPORT in held else None


def _data(held: Mapping[str, BundleFile], name: str) -> bytes:
    data = held[name].data
    assert data is not None
    return data


def _without(name: str, fault: EvidenceError) -> str:
    """The fault without the name that the finding has already."""
    return str(fault).removeprefix(f"{name}: ")
