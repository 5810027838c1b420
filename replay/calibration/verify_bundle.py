"""The command `verify`: verify a bundle by itself, then against its recordings and logs."""

import datetime as dt
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from estimators.errors import EvidenceError, format_count
from recordings.calibration.bundle_checks import check_bundle
from recordings.calibration.bundle_folder import (
    EVIDENCE,
    NOTARY,
    PDF,
    RECORDING,
    REPORT,
    STATEMENT,
    parse_sha256sums,
)
from recordings.calibration.calibration_recording import make_run_of_calibration
from recordings.calibration.calibration_report import render_report_html
from recordings.calibration.calibration_text import (
    describe_runs_with_swapped_loads,
    describe_undetectable_faults,
)
from recordings.calibration.check_outcomes import (
    BundleFinding,
    BundleOutcome,
    find_most_severe_outcome,
    format_bundle_verdict,
)
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog
from recordings.calibration.timestamp import read_authority_certificates
from recordings.calibration.untrusted_files import (
    RecordingDigests,
    compare_words_of_pdf_with_html,
    digest_bundle_recordings,
)
from recordings.signatures.keyring import load_keyring
from recordings.signatures.signed_by import SignedBy
from recordings.signatures.signing import read_public_key_file
from replay.calibration.compare_logs import replay_logs_and_record_differences

#: Statement that no check verifies the pictures that a recording has besides its frames.
_DRAWN = (
    "What a viewer shows of a recording: its frames are compared, but not the curves and texts "
    "drawn from them. `payscope view` of your own replay draws them again."
)


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of a verification.

    Attributes:
        folder: folder of the bundle.
        findings: errors, each with its file or item.
        notes: remarks that are not errors.
        checks_made: checks that were made, as sentences.
        unverifiable_statements: statements that no check can verify.
        signed_by: signer of the bundle.
        checked: files read from the folder, and the result of each.
    """

    folder: Path
    findings: tuple[BundleFinding, ...]
    notes: tuple[str, ...]
    checks_made: tuple[str, ...]
    unverifiable_statements: tuple[str, ...]
    signed_by: SignedBy
    checked: CheckedBundle = field(repr=False)

    @property
    def outcome(self) -> BundleOutcome | None:
        """Worst outcome of the findings, which sets the exit status; None if nothing is wrong."""
        return find_most_severe_outcome(self.findings)

    @property
    def verdict(self) -> str:
        """The outcome of the verification, as a sentence."""
        return format_bundle_verdict(self.folder, self.findings, f"verified; {self.signed_by}")

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "folder": str(self.folder),
            "outcome": 0 if self.outcome is None else int(self.outcome),
            "signed_by": asdict(self.signed_by) | {"trusted": self.signed_by.is_trusted},
            "findings": [
                {"kind": each.kind, "item": each.item, "what": each.what} for each in self.findings
            ],
            "notes": list(self.notes),
            "checked": list(self.checks_made),
            "no_check_can_find": list(self.unverifiable_statements),
        }


def verify_bundle(
    folder: Path,
    *,
    log_folder: Path | None = None,
    key_file: Path | None = None,
    previous: Path | None = None,
    is_signature_required: bool = False,
    verification_day: dt.date | None = None,
    authority_certificates: Path | None = None,
) -> Verification:
    """Verify a bundle.

    Args:
        folder: the bundle; no file in it is executed and no link followed.
        log_folder: folder of its logs; they are found by their digests, replayed and compared.
        key_file: public key of the required signer.
        previous: the machine's previous evidence.
        is_signature_required: whether a signature by `key_file` or a key in the user's keyring is
            required.
        verification_day: day on which it must be valid; None for today in the machine's time zone.

        authority_certificates: root certificates of trusted time-stamp authorities, in PEM.

    Raises:
        EvidenceError: the folder does not exist, or a key or certificate cannot be read.
    """
    key = None if key_file is None else read_public_key_file(key_file)
    authorities = (
        ()
        if authority_certificates is None
        else read_authority_certificates(authority_certificates)
    )
    if log_folder is not None and not log_folder.is_dir():
        raise EvidenceError(f"{log_folder}: no such folder; give the folder with the logs")
    bundle = check_bundle(folder, key, previous, load_keyring(), authorities)
    if is_signature_required and not bundle.signed_by.is_trusted and not bundle.evidence_faults:
        what = f"{bundle.signed_by}, but a signature by a known key is required"
        bundle.add_finding(BundleOutcome.INCOMPLETE, STATEMENT, what)
    keeper = bundle.notarised_by
    if (
        is_signature_required
        and keeper is not None
        and not keeper.is_trusted
        and not bundle.evidence_faults
    ):
        what = f"is {keeper}, but a signature by a key of the keyring is required"
        bundle.add_finding(BundleOutcome.INCOMPLETE, NOTARY, what)
    document = bundle.document
    done = list_checks_done(bundle, previous is not None)
    files = FilesCheck()
    if document is not None:
        files = compare_bundle_files_with_evidence(
            bundle, document, folder, are_calibration_and_pdf_compared=log_folder is not None
        )
    if log_folder is not None and document is not None and bundle.readings is not None:
        replay_logs_and_record_differences(bundle, document, bundle.readings, log_folder)
        done.append(
            f"{format_count(len(document.logs), 'log')} replayed: every reading, and begin, "
            "duration, topics, counts, stamps, losses, notes, speeds and verdict of each log "
            "compared"
        )
    elif document is not None:
        bundle.notes.append(
            "the logs were not replayed: only --logs shows that the readings come from them"
        )
    done += files.comparisons_made
    if document is not None:
        # with other findings, the points need not be such that a line can be fitted to them
        bundle.notes += [] if bundle.findings else describe_runs_with_swapped_loads(document)
        add_expiry_finding(bundle, document, verification_day)
    return Verification(
        folder,
        tuple(bundle.findings),
        tuple(bundle.notes),
        tuple(done),
        ()
        if document is None
        else (
            *describe_undetectable_faults(document),
            *files.comparisons_not_made,
            *iter_statements_nobody_can_verify(document),
        ),
        bundle.signed_by,
        bundle,
    )


def iter_statements_nobody_can_verify(document: EvidenceDocument) -> Iterator[str]:
    """Yield the claims of the evidence that `verify` cannot check, whatever files it has."""
    yield (
        "Whether what the campaign file states about people, place, conditions, sensors and "
        "parts is true, and which software and platform made this: there is only the maker's "
        "statement."
    )
    if document.signer is None:
        yield "Who made this evidence: it is unsigned."


def add_expiry_finding(
    checked_bundle: CheckedBundle, document: EvidenceDocument, verification_day: dt.date | None
) -> None:
    """Add a finding if the evidence has expired by a day; None is today in the machine's zone."""
    zone = document.machine.machine.time_zone
    day = verification_day or dt.datetime.now(zone).date()
    if document.expires < day:
        what = (
            f"on {document.expires}: it calibrates no log of a later day, such as {day}; "
            "--on DATE verifies it as of another day"
        )
        checked_bundle.add_finding(BundleOutcome.EXPIRED, f"{EVIDENCE}: expires", what)


def list_checks_done(checked_bundle: CheckedBundle, is_chain_checked: bool) -> list[str]:
    """List in words the checks that the bundle alone allowed, without recordings or logs."""
    done = ["names and digests of every file; nothing in the folder was run"]
    if checked_bundle.document is not None:
        done.append("the schema of evidence.json")
        done += (
            [f"the signature: {checked_bundle.signed_by}"]
            if checked_bundle.signed_by.is_trusted
            else []
        )
        done += ["the chain, to the previous evidence"] if is_chain_checked else []
    if checked_bundle.notarised_by is not None and checked_bundle.document is not None:
        stretch = checked_bundle.document.campaign.notary
        assert stretch is not None
        done.append(
            f"the recorder's list, number {stretch.first} to {stretch.last}: signatures, chain, "
            f"and each log in the campaign or left out with a reason; {checked_bundle.notarised_by}"
        )
    if checked_bundle.readings is not None:
        done.append("fit, budget, limits, points, report and each reason, recomputed")
    return done


@dataclass(frozen=True, slots=True)
class FilesCheck:
    """Results of comparing files, and files that could not be compared.

    Attributes:
        comparisons_made: comparisons that were made, in words.
        comparisons_not_made: comparisons that could not be made, and why.
    """

    comparisons_made: tuple[str, ...] = ()
    comparisons_not_made: tuple[str, ...] = ()


def compare_bundle_files_with_evidence(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    folder: Path,
    *,
    are_calibration_and_pdf_compared: bool,
) -> FilesCheck:
    """Compare the recordings of runs with the evidence, and optionally the slower items.

    Args:
        checked_bundle: the bundle, which receives the findings.
        document: evidence of the bundle.
        folder: folder of the bundle.
        are_calibration_and_pdf_compared: whether to compare also the
            recording of the calibration and the PDF.
    """
    try:
        sums = parse_sha256sums(checked_bundle.sums)
    except EvidenceError:
        return FilesCheck()  # the invalid file is a finding already
    done: list[str] = []
    unseen: list[str] = []
    runs = [log for log in document.logs if log.recording in sums]
    names = [
        *(log.recording for log in runs),
        *([RECORDING] if are_calibration_and_pdf_compared and RECORDING in sums else []),
    ]
    found = digest_bundle_recordings(folder, {name: sums[name] for name in names})
    for log in runs:
        _compare_recording_of_run(checked_bundle, log, found[log.recording])
    if runs:
        done.append("the frames of each run's recording, by their fingerprint")
    if are_calibration_and_pdf_compared and RECORDING in sums:
        _compare_recording_of_calibration(checked_bundle, document, found[RECORDING])
        done.append(f"the frames of {RECORDING}, recomputed")
    elif not are_calibration_and_pdf_compared:
        unseen.append(
            f"Whether {RECORDING} and {PDF} show the same as {REPORT}: --logs compares them."
        )
    if are_calibration_and_pdf_compared and PDF in sums:
        why = _compare_pdf_or_explain_why_not(checked_bundle, document, folder, sums)
        if why:
            unseen.append(f"Whether {PDF} has the same words as {REPORT}: {why}.")
        else:
            done.append(f"the words of {PDF}, compared with those of {REPORT}")
    if runs or are_calibration_and_pdf_compared:
        unseen.append(_DRAWN)
    return FilesCheck(tuple(done), tuple(unseen))


def _compare_recording_of_run(
    checked_bundle: CheckedBundle,
    evidence_log: EvidenceLog,
    recording_digests: RecordingDigests | str,
) -> None:
    """Check that a recording matches the replay's fingerprint in the evidence."""
    if isinstance(recording_digests, str):
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED, evidence_log.recording, recording_digests
        )
        return
    wanted = {
        "files": (
            sorted(file.sha256 for file in evidence_log.files),
            sorted(recording_digests.inputs),
        ),
        "settings": (evidence_log.settings_fingerprint, recording_digests.settings),
        "frames": (evidence_log.results_fingerprint, recording_digests.results),
    }
    for what, (there, here) in wanted.items():
        if there != here:
            checked_bundle.add_finding(
                BundleOutcome.TAMPERED,
                evidence_log.recording,
                f"differs in its {what} from the replay of {evidence_log.log} with the fingerprint "
                "in the "
                "evidence",
            )


def _compare_recording_of_calibration(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    recording_digests: RecordingDigests | str,
) -> None:
    """Check that the recording of the calibration contains the frames of the evidence."""
    if isinstance(recording_digests, str):
        checked_bundle.add_finding(BundleOutcome.TAMPERED, RECORDING, recording_digests)
        return
    if checked_bundle.readings is None or checked_bundle.points is None:
        return
    made = make_run_of_calibration(
        document, checked_bundle.readings, checked_bundle.points
    ).provenance
    taken = made.fingerprint
    assert taken is not None
    other = sorted(
        name
        for name in {*taken.frames, *recording_digests.frames}
        if taken.frames.get(name) != recording_digests.frames.get(name)
    )
    same_words = document.other_payscope_version or made.notes == recording_digests.notes
    if not other and same_words:
        return
    what = f"frames {', '.join(other)}" if other else "words"
    outcome = (
        BundleOutcome.OTHER_VERSION if document.other_payscope_version else BundleOutcome.TAMPERED
    )
    checked_bundle.add_finding(outcome, RECORDING, f"differs in its {what} from the evidence")


def _compare_pdf_or_explain_why_not(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    folder: Path,
    expected_digests: Mapping[str, str],
) -> str:
    """Compare the text of the PDF with the evidence; return why it could not be done, else ""."""
    if document.other_payscope_version:
        return f"its page was made by {document.other_payscope_version}"
    if checked_bundle.readings is None or checked_bundle.points is None:
        return "its page could not be recomputed"
    html = render_report_html(document, checked_bundle.readings, checked_bundle.points)
    fault, why = compare_words_of_pdf_with_html(folder, expected_digests[PDF], html)
    if fault:
        checked_bundle.add_finding(BundleOutcome.TAMPERED, PDF, fault)
    return why
