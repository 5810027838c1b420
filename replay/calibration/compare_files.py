"""The files of a bundle that no digest in its evidence binds: its recordings and its PDF."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import PDF, RECORDING, REPORT, parse_sums
from recordings.calibration.calibration_recording import calibration_run
from recordings.calibration.calibration_report import report_html
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog
from recordings.calibration.pdf_check import pdf_fault
from recordings.calibration.strange_files import RecordingDigests, recording_digests

#: What the viewer draws of a recording is made of its frames when it is written.
_DRAWN = (
    "What a viewer draws of a recording: its frames are compared, and not the series and texts "
    "that were drawn of them. `payscope view` of a replay of your own draws them anew."
)


@dataclass(frozen=True, slots=True)
class FilesCheck:
    """What was compared, and what could not be.

    Attributes:
        done: what was compared, in words.
        unseen: what was not, and why.
    """

    done: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()


def compare_files(
    checked: CheckedBundle, document: EvidenceDocument, folder: Path, *, whole: bool
) -> FilesCheck:
    """Compare the recordings of runs with their fingerprints and, if asked for, what takes longer.

    Args:
        checked: of the bundle; gets what is found.
        document: its evidence.
        folder: the bundle.
        whole: whether the recording of the calibration and the PDF are read as well.
    """
    try:
        sums = parse_sums(checked.sums)
    except EvidenceError:
        return FilesCheck()  # which is a finding already
    done: list[str] = []
    unseen: list[str] = []
    runs = [log for log in document.logs if log.recording in sums]
    names = [
        *(log.recording for log in runs),
        *([RECORDING] if whole and RECORDING in sums else []),
    ]
    found = recording_digests(folder, {name: sums[name] for name in names})
    for log in runs:
        _compare_run(checked, log, found[log.recording])
    if runs:
        done.append("the frames of each run's recording, by their fingerprint")
    if whole and RECORDING in sums:
        _compare_calibration(checked, document, found[RECORDING])
        done.append(f"the frames of {RECORDING}, made anew")
    elif not whole:
        unseen.append(
            f"Whether {RECORDING} and {PDF} show what {REPORT} does: with --logs they are compared."
        )
    if whole and PDF in sums:
        why = _compare_pdf(checked, document, folder, sums)
        if why:
            unseen.append(f"Whether {PDF} reads as {REPORT} does: {why}.")
        else:
            done.append(f"the words of {PDF}, with those of {REPORT}")
    if runs or whole:
        unseen.append(_DRAWN)
    return FilesCheck(tuple(done), tuple(unseen))


def _compare_run(checked: CheckedBundle, log: EvidenceLog, found: RecordingDigests | str) -> None:
    """Whether a recording is that of the replay whose fingerprint the evidence has."""
    if isinstance(found, str):
        checked.add(BundleOutcome.TAMPERED, log.recording, found)
        return
    wanted = {
        "files": (sorted(file.sha256 for file in log.files), sorted(found.inputs)),
        "settings": (log.settings_fingerprint, found.settings),
        "frames": (log.results_fingerprint, found.results),
    }
    for what, (there, here) in wanted.items():
        if there != here:
            checked.add(
                BundleOutcome.TAMPERED,
                log.recording,
                f"is of other {what} than the replay of {log.log} whose fingerprint the evidence "
                "has",
            )


def _compare_calibration(
    checked: CheckedBundle, document: EvidenceDocument, found: RecordingDigests | str
) -> None:
    """Whether the recording of a bundle has the frames that its evidence gives."""
    if isinstance(found, str):
        checked.add(BundleOutcome.TAMPERED, RECORDING, found)
        return
    if checked.readings is None or checked.points is None:
        return
    made = calibration_run(document, checked.readings, checked.points).provenance
    taken = made.fingerprint
    assert taken is not None
    other = sorted(
        name
        for name in {*taken.frames, *found.frames}
        if taken.frames.get(name) != found.frames.get(name)
    )
    same_words = document.made_elsewhere or made.notes == found.notes
    if not other and same_words:
        return
    what = f"frames {', '.join(other)}" if other else "words"
    outcome = BundleOutcome.OTHER_VERSION if document.made_elsewhere else BundleOutcome.TAMPERED
    checked.add(outcome, RECORDING, f"has other {what} than the evidence gives")


def _compare_pdf(
    checked: CheckedBundle, document: EvidenceDocument, folder: Path, sums: Mapping[str, str]
) -> str:
    """Compare the PDF; why it could not be, or ""."""
    if document.made_elsewhere:
        return f"its page is one by {document.made_elsewhere}"
    if checked.readings is None or checked.points is None:
        return "its page could not be made anew"
    html = report_html(document, checked.readings, checked.points)
    fault, why = pdf_fault(folder, sums[PDF], html)
    if fault:
        checked.add(BundleOutcome.TAMPERED, PDF, fault)
    return why
