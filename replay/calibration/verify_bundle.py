"""The command `verify`: a bundle checked by itself, and against its logs."""

import datetime as dt
import os
import stat
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.calibration.use.learnt_priors import TermOfLog
from estimators.errors import EvidenceError, PayscopeError, counted
from estimators.file_digest import file_sha256
from recordings.calibration.bundle_checks import check_bundle
from recordings.calibration.bundle_folder import EVIDENCE, READINGS, STATEMENT
from recordings.calibration.calibration_text import unseen
from recordings.calibration.check_outcomes import BundleFinding, BundleOutcome, worst
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog
from recordings.calibration.keyring import load_keyring
from recordings.calibration.signed_by import SignedBy
from recordings.calibration.signing import public_key
from recordings.calibration.timestamp import authority_certificates

_MOST_ENTRIES: Final = 100_000
_DEEPEST: Final = 8
_MOST_NAMED: Final = 10
#: Of its prior, by so much a nuisance may come out otherwise elsewhere.
_TERMS: Final = 1e-6
#: Numbers of a reading, and the texts that must be equal.
_NUMBERS: Final = ("start_s", "end_s", "mass_kg", "std_kg", "common_u_kg")
_TEXTS: Final = ("run_id", "load_id", "day", "log", "reading", "used", "reason")


@dataclass(frozen=True, slots=True)
class Verified:
    """What a verification came to.

    Attributes:
        folder: the bundle.
        findings: what is wrong, each with its item.
        notes: what a reader should know besides.
        done: what was checked, in words.
        unseen: what no check can find.
        signed_by: whose signature it has.
    """

    folder: Path
    findings: tuple[BundleFinding, ...]
    notes: tuple[str, ...]
    done: tuple[str, ...]
    unseen: tuple[str, ...]
    signed_by: SignedBy

    @property
    def outcome(self) -> BundleOutcome | None:
        """The exit status; None where nothing is wrong."""
        return worst(list(self.findings))

    @property
    def verdict(self) -> str:
        """The outcome in a sentence."""
        outcome = self.outcome
        if outcome is None:
            return f"{self.folder}: verified; {self.signed_by}"
        kind = next(each.kind for each in self.findings if each.outcome is outcome)
        return f"{self.folder}: {kind.upper()} ({counted(len(self.findings), 'finding')})"

    def to_dict(self) -> dict[str, Any]:
        """The same as plain values."""
        return {
            "folder": str(self.folder),
            "outcome": 0 if self.outcome is None else int(self.outcome),
            "signed_by": asdict(self.signed_by) | {"trusted": self.signed_by.trusted},
            "findings": [
                {"kind": each.kind, "item": each.item, "what": each.what} for each in self.findings
            ],
            "notes": list(self.notes),
            "checked": list(self.done),
            "no_check_can_find": list(self.unseen),
        }


def verify(
    folder: Path,
    *,
    logs: Path | None = None,
    key_file: Path | None = None,
    previous: Path | None = None,
    signed: bool = False,
    on: dt.date | None = None,
    tsa: Path | None = None,
) -> Verified:
    """Check a bundle.

    Args:
        folder: the bundle; nothing in it is run, no link followed.
        logs: where its logs are; all are replayed and compared. They are found by their digests.
        key_file: the public key of whose signature is asked for.
        previous: the machine's evidence before it.
        signed: whether a signature by `key_file` or by a key of the user's keyring is asked for.
        on: the day on which it is to be valid; None for today, where the machine is.

        tsa: root certificates of the time-stamp authorities that are trusted, in PEM.

    Raises:
        EvidenceError: no such folder, or a key or certificate that cannot be read.
    """
    key = None if key_file is None else public_key(key_file)
    authorities = () if tsa is None else authority_certificates(tsa)
    if logs is not None and not logs.is_dir():
        raise EvidenceError(f"{logs}: no such folder; name the folder with the logs")
    checked = check_bundle(folder, key, previous, load_keyring(), authorities)
    if signed and not checked.signed_by.trusted and not checked.faults:
        what = f"{checked.signed_by}, and a signature by a known key is asked for"
        checked.add(BundleOutcome.INCOMPLETE, STATEMENT, what)
    document = checked.document
    done = _done(checked, previous is not None)
    if logs is not None and document is not None and checked.readings is not None:
        _replay(checked, document, checked.readings, logs)
        done.append(f"{counted(len(document.logs), 'log')} replayed and every reading compared")
    elif document is not None:
        checked.notes.append(
            "the logs were not replayed: that the readings are theirs, only --logs shows"
        )
    if document is not None:
        _check_expiry(checked, document, on)
    return Verified(
        folder,
        tuple(checked.findings),
        tuple(checked.notes),
        tuple(done),
        () if document is None else tuple(unseen(document)),
        checked.signed_by,
    )


def _check_expiry(checked: CheckedBundle, document: EvidenceDocument, on: dt.date | None) -> None:
    """Whether it is still valid on the day, today where the machine is by default."""
    zone = document.machine.machine.zone
    day = on or dt.datetime.now(zone).date()
    if document.expires < day:
        what = f"on {document.expires}: it calibrates no log of a later day, such as {day}"
        checked.add(BundleOutcome.EXPIRED, f"{EVIDENCE}: expires", what)


def _done(checked: CheckedBundle, chained: bool) -> list[str]:
    """What a check of the folder itself looked at."""
    done = ["names and digests of every file; nothing in the folder was run"]
    if checked.document is not None:
        done.append("the schema of evidence.json")
        done += [f"the signature: {checked.signed_by}"] if checked.signed_by.trusted else []
        done += ["the chain, to the evidence before"] if chained else []
    if checked.readings is not None:
        done.append("fit, budget, limits, points, report and each reason, computed anew")
    return done


def _replay(
    checked: CheckedBundle, document: EvidenceDocument, stored: pl.DataFrame, folder: Path
) -> None:
    """Replay every log, and compare reading by reading."""
    paths: dict[str, Path] = {}
    found = _files_by_name(folder, {file.name for log in document.logs for file in log.files})
    for log in document.logs:
        path = _path_of(checked, log, found)
        if path is not None:
            paths[log.log] = path
    if len(paths) < len(document.logs):
        return
    # the estimators are slow to import, and only a replay needs them
    from replay.calibration.campaign_runs import replay_runs

    campaign = document.campaign
    try:
        if document.learnt is not None and document.kind == "calibration":
            before = replay_runs(campaign, document.machine, lambda log: paths[log])
            _compare_terms(checked, document.learnt.logs, before.terms)
        replayed = replay_runs(campaign, document.weighing, lambda log: paths[log])
    except PayscopeError as fault:
        checked.add(BundleOutcome.IRREPRODUCIBLE, "logs", str(fault))
        return
    _compare(checked, document, stored, replayed.readings)
    for kept, anew in zip(document.logs, replayed.logs, strict=True):
        item = f"{EVIDENCE}: logs: {kept.log}"
        if (kept.can_weigh, kept.failed_checks) != (anew.can_weigh, anew.failed_checks):
            checked.add(BundleOutcome.IRREPRODUCIBLE, item, "its replay gives another verdict")
        if kept.settings_fingerprint != anew.settings_fingerprint:
            checked.add(BundleOutcome.IRREPRODUCIBLE, item, "was replayed with other settings")
        elif kept.results_fingerprint != anew.results_fingerprint:
            checked.notes.append(
                f"{kept.log}: the frames of its replay differ in their last bits, as other "
                "processors and libraries make them"
            )


def _compare_terms(
    checked: CheckedBundle, stored: tuple[TermOfLog, ...], anew: tuple[TermOfLog, ...]
) -> None:
    """What each log says of the nuisances under the machine's own priors."""
    by_name = {(each.log, each.term): each for each in anew}
    wrong = [each for each in stored if not _same(each, by_name.get((each.log, each.term)))]
    for each in wrong[:_MOST_NAMED]:
        item = f"{EVIDENCE}: learnt: {each.log}, {each.term}"
        checked.add(BundleOutcome.IRREPRODUCIBLE, item, "its replay says something else")
    if not wrong and len(stored) != len(anew):
        item = f"{EVIDENCE}: learnt"
        checked.add(BundleOutcome.IRREPRODUCIBLE, item, "its logs say more than it has")


def _same(kept: TermOfLog, now: TermOfLog | None) -> bool:
    if now is None:
        return False
    tolerance = _TERMS * kept.prior_std
    names = ("prior_mean", "prior_std", "posterior", "posterior_std")
    return all(abs(getattr(kept, name) - getattr(now, name)) <= tolerance for name in names)


def _compare(
    checked: CheckedBundle, document: EvidenceDocument, stored: pl.DataFrame, anew: pl.DataFrame
) -> None:
    """Reading by reading, within the declared tolerance."""
    if stored.height != anew.height:
        what = f"has {stored.height} readings, and the replay gives {anew.height}"
        checked.add(BundleOutcome.IRREPRODUCIBLE, READINGS, what)
        return
    tolerance = document.replay_tolerance_kg
    wrong = 0
    for kept, now in zip(stored.iter_rows(named=True), anew.iter_rows(named=True), strict=True):
        differing = [name for name in _TEXTS if kept[name] != now[name]]
        differing += [name for name in _NUMBERS if not _near(kept[name], now[name], tolerance)]
        if differing:
            wrong += 1
            if wrong <= _MOST_NAMED:
                item = f"{READINGS}: run '{kept['run_id']}', reading {kept['reading']}"
                what = f"the replay gives another {', '.join(differing)}"
                checked.add(BundleOutcome.IRREPRODUCIBLE, item, what)
    if wrong > _MOST_NAMED:
        checked.add(
            BundleOutcome.IRREPRODUCIBLE, READINGS, f"and {wrong - _MOST_NAMED} readings more"
        )


def _near(kept: float | None, now: float | None, tolerance: float) -> bool:
    if kept is None or now is None:
        return kept is now
    return abs(kept - now) <= tolerance


def _path_of(checked: CheckedBundle, log: EvidenceLog, found: dict[str, list[Path]]) -> Path | None:
    """Where a log is: its files, by name and digest, all in one folder."""
    item = f"logs: {log.log}"
    places: list[Path] | None = None
    for file in log.files:
        named = found.get(file.name, [])
        same = [path.parent for path in named if file_sha256(path) == file.sha256]
        if not same:
            if named:
                what = f"'{file.name}' is not the file of the evidence"
                checked.add(BundleOutcome.TAMPERED, item, what)
            else:
                what = f"'{file.name}' is not in the folder of logs"
                checked.add(BundleOutcome.INCOMPLETE, item, what)
            return None
        places = same if places is None else [place for place in places if place in same]
    if not places:
        checked.add(BundleOutcome.INCOMPLETE, item, "its files are not together in one folder")
        return None
    # a rosbag2 directory is opened as a whole; its folder may have another name now
    name = log.files[0].name
    is_file = len(log.files) == 1 and Path(log.log).name == name
    return places[0] / name if is_file else places[0]


def _files_by_name(folder: Path, wanted: set[str]) -> dict[str, list[Path]]:
    """Regular files of these names in a folder and those in it; no link is followed."""
    found: dict[str, list[Path]] = {}
    for number, entry in enumerate(_walk(folder, 0)):
        if number >= _MOST_ENTRIES:
            raise EvidenceError(f"{folder}: more than {_MOST_ENTRIES} entries; name a smaller one")
        if entry.name in wanted and stat.S_ISREG(entry.stat(follow_symlinks=False).st_mode):
            found.setdefault(entry.name, []).append(Path(entry.path))
    return found


def _walk(folder: Path, depth: int) -> "Iterator[os.DirEntry[str]]":
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda each: each.name):
            yield entry
            if depth < _DEEPEST and entry.is_dir(follow_symlinks=False):
                yield from _walk(Path(entry.path), depth + 1)
