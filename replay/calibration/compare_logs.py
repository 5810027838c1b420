"""Find the logs of evidence by their digests, replay them, and compare the results."""

import os
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.calibration.campaign.campaign_fit import (
    list_stated_uncertainties_of_force_scale,
    make_calibration_options,
)
from analysis.calibration.use.learnt_priors import TermOfLog
from analysis.model.check_names import replace_former_check_names
from estimators.errors import EvidenceError, PayscopeError
from estimators.file_digest import file_sha256
from recordings.calibration.bundle_folder import EVIDENCE, READINGS
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog
from replay.calibration.campaign_limits import LIMITS

if TYPE_CHECKING:
    from replay.calibration.campaign_runs import CampaignReplay

#: Numbers of a reading that are compared; its texts must be equal.
_NUMBERS: Final = ("start_s", "end_s", "mass_kg", "std_kg", "common_u_kg")
#: Facts that evidence keeps of a log besides readings and verdict, and the finding if they differ.
_OF_THE_LOG: Final = {
    "files": "the files differ",
    "topics": "topics, counts of messages or their stamps differ",
    "begins": "its start time differs",
    "duration_s": "its duration differs",
    "speed_range_m_s": "its speeds differ",
    "losses": "other losses",
    "notes": "other notes",
    "machine_id": "its metadata name another machine",
}
#: Facts whose wording differs between versions.
_IN_WORDS: Final = ("losses", "notes")
_TEXTS: Final = ("run_id", "load_id", "day", "log", "reading", "used", "reason")


def replay_logs_and_record_differences(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    stored_readings: pl.DataFrame,
    log_folder: Path,
) -> None:
    """Replay every log and compare each reading with the evidence."""
    paths: dict[str, Path] = {}
    found = _find_files_below_folder_by_name(
        log_folder, {file.name for log in document.logs for file in log.files}
    )
    for log in document.logs:
        path = find_log_path(checked_bundle, log, found)
        if path is not None:
            paths[log.log] = path
    if len(paths) < len(document.logs):
        return
    # the estimators are slow to import, and only a replay needs them
    from replay.calibration.campaign_runs import replay_campaign_logs

    campaign = document.campaign
    try:
        if document.learnt is not None and document.kind == "calibration":
            before = replay_campaign_logs(
                campaign,
                document.machine,
                lambda log: paths[log],
                procedure=document.procedure_rules,
            )
            _compare_learnt_terms(checked_bundle, document.learnt.logs, before.terms)
        replayed = replay_campaign_logs(
            campaign,
            document.weighing_machine,
            lambda log: paths[log],
            procedure=document.procedure_rules,
        )
    except PayscopeError as fault:
        checked_bundle.add_finding(BundleOutcome.IRREPRODUCIBLE, "logs", str(fault))
        return
    compare_readings_with_evidence(checked_bundle, document, stored_readings, replayed.readings)
    for kept, anew in zip(document.logs, replayed.logs, strict=True):
        _compare_replayed_log(checked_bundle, document, kept, anew)
    # a check repeats the responses and parts of the calibration that it checks
    if document.kind == "calibration":
        _compare_run_responses(checked_bundle, document, replayed)
        _compare_stated_parts_of_fit(checked_bundle, document, replayed)


def _compare_replayed_log(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    evidence_log: EvidenceLog,
    replayed_log: EvidenceLog,
) -> None:
    """Compare the verdict and all other facts of a log, except its readings."""
    item = f"{EVIDENCE}: logs: {evidence_log.log}"
    failed_checks = tuple(map(replace_former_check_names, evidence_log.failed_checks))
    if (evidence_log.can_weigh, failed_checks) != (
        replayed_log.can_weigh,
        replayed_log.failed_checks,
    ):
        what = (
            "its replay gives a different verdict: "
            f"{_describe_verdict(replayed_log.can_weigh, replayed_log.failed_checks)} in the "
            f"replay, {_describe_verdict(evidence_log.can_weigh, failed_checks)} in the evidence"
        )
        checked_bundle.add_finding(BundleOutcome.IRREPRODUCIBLE, item, what)
    if any(name.startswith("machine.") for name in document.settings_at_default):
        checked_bundle.notes.append(
            f"{evidence_log.log}: settings and frames are compared by value only, not by "
            "digest: this version has settings that the evidence lacks"
        )
    elif evidence_log.settings_fingerprint != replayed_log.settings_fingerprint:
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE, item, "was replayed with different settings"
        )
    elif evidence_log.results_fingerprint != replayed_log.results_fingerprint:
        checked_bundle.notes.append(
            f"{evidence_log.log}: the frames of its replay differ in their last bits, as happens "
            "with other processors and libraries"
        )
    for name, what in _OF_THE_LOG.items():
        if name == "machine_id" and name not in evidence_log.model_fields_set:
            continue  # absent in earlier formats
        there, here = getattr(evidence_log, name), getattr(replayed_log, name)
        if are_values_equal_but_for_rounding(there, here):
            continue
        words = name in _IN_WORDS and document.other_payscope_version
        outcome = BundleOutcome.OTHER_VERSION if words else BundleOutcome.IRREPRODUCIBLE
        stored, found = _format_compared_value(there), _format_compared_value(here)
        said = f"{what}: {stored} in the evidence, {found} in the replay"
        checked_bundle.add_finding(outcome, f"{item}: {name}", said)


def _describe_verdict(can_weigh: bool, failed_checks: Sequence[str]) -> str:
    """Say whether a log can weigh, and which checks failed."""
    failed = f" with {', '.join(failed_checks)} failed" if failed_checks else ""
    return f"{'can weigh' if can_weigh else 'cannot weigh'}{failed}"


def are_values_equal_but_for_rounding(stored_value: object, replayed_value: object) -> bool:
    """Whether two values are equal; seconds and speeds may differ in their last bits."""
    if isinstance(stored_value, float) and isinstance(replayed_value, float):
        return abs(stored_value - replayed_value) <= LIMITS.last_bits_1 * max(
            abs(stored_value), abs(replayed_value)
        )
    if isinstance(stored_value, tuple) and isinstance(replayed_value, tuple):
        return len(stored_value) == len(replayed_value) and all(
            map(are_values_equal_but_for_rounding, stored_value, replayed_value)
        )
    return stored_value == replayed_value


def _format_compared_value(value: object) -> str:
    if value in ((), ""):
        return "none"
    text = "; ".join(map(_format_compared_value, value)) if isinstance(value, tuple) else str(value)
    return text if len(text) <= LIMITS.quoted_characters else f"{text[: LIMITS.quoted_characters]}…"


def _compare_run_responses(
    checked_bundle: CheckedBundle, document: EvidenceDocument, replay: "CampaignReplay"
) -> None:
    """Compare how far errors of the learnt means move each run: later intervals depend on it."""
    if document.learnt is None or not document.states_run_responses:
        return
    stored, replayed = (
        {(each.run_id, each.term): each.response_kg for each in responses}
        for responses in (document.learnt.responses, replay.responses)
    )
    wrong = [
        (run_id, term)
        for run_id, term in sorted({*stored, *replayed})
        if not _is_reading_within_tolerance(
            stored.get((run_id, term)), replayed.get((run_id, term)), document.replay_tolerance_kg
        )
    ]
    for run_id, term in wrong[: LIMITS.max_logs]:
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE,
            f"{EVIDENCE}: learnt.responses: run '{run_id}', {term}",
            "the replay gives a different response of the mass to an error of the learnt mean",
        )
    if len(wrong) > LIMITS.max_logs:
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE,
            f"{EVIDENCE}: learnt.responses",
            f"and {len(wrong) - LIMITS.max_logs} more",
        )


def _compare_stated_parts_of_fit(
    checked_bundle: CheckedBundle, document: EvidenceDocument, replay: "CampaignReplay"
) -> None:
    """Compare the parts of the fit's budget that the replays take from the machine file."""
    options = make_calibration_options(
        document.campaign,
        list_stated_uncertainties_of_force_scale(document.campaign, replay.budgets),
    )
    stored, replayed = (
        {part.component: (part.absorbed, part.u_kg) for part in each.stated}
        for each in (document.options, options)
    )
    for component in sorted({*stored, *replayed}):
        there, here = stored.get(component), replayed.get(component)
        if (
            there is not None
            and here is not None
            and there[0] == here[0]
            and _is_reading_within_tolerance(there[1], here[1], document.replay_tolerance_kg)
        ):
            continue
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE,
            f"{EVIDENCE}: options.stated: {component}",
            "the replay gives a different uncertainty of it",
        )


def _compare_learnt_terms(
    checked_bundle: CheckedBundle,
    stored_terms: tuple[TermOfLog, ...],
    replayed_terms: tuple[TermOfLog, ...],
) -> None:
    """Compare each log's nuisance estimates under the machine's own priors."""
    by_name = {(each.log, each.term): each for each in replayed_terms}
    wrong = [
        each
        for each in stored_terms
        if not is_learnt_term_reproduced(each, by_name.get((each.log, each.term)))
    ]
    for each in wrong[: LIMITS.max_logs]:
        item = f"{EVIDENCE}: learnt: {each.log}, {each.term}"
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE, item, "its replay gives different estimates"
        )
    if not wrong and len(stored_terms) != len(replayed_terms):
        item = f"{EVIDENCE}: learnt"
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE, item, "its logs determine more terms than it lists"
        )


def is_learnt_term_reproduced(evidence_term: TermOfLog, replayed_term: TermOfLog | None) -> bool:
    """Whether a replayed term equals the term in the evidence within tolerance."""
    if replayed_term is None:
        return False
    tolerance = LIMITS.term_tolerance_1 * evidence_term.prior_std
    names = ("prior_mean", "prior_std", "posterior", "posterior_std")
    return all(
        abs(getattr(evidence_term, name) - getattr(replayed_term, name)) <= tolerance
        for name in names
    )


def compare_readings_with_evidence(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    stored_readings: pl.DataFrame,
    replayed_readings: pl.DataFrame,
) -> None:
    """Compare the replayed readings with the stored ones, within the tolerance in the evidence."""
    if stored_readings.height != replayed_readings.height:
        what = (
            f"has {stored_readings.height} readings, but the replay gives "
            f"{replayed_readings.height}"
        )
        checked_bundle.add_finding(BundleOutcome.IRREPRODUCIBLE, READINGS, what)
        return
    tolerance = document.replay_tolerance_kg
    wrong = 0
    for kept, now in zip(
        stored_readings.iter_rows(named=True), replayed_readings.iter_rows(named=True), strict=True
    ):
        reason = kept["reason"] and replace_former_check_names(kept["reason"])
        present = {**kept, "reason": reason}
        differing = [name for name in _TEXTS if present[name] != now[name]]
        differing += [
            name
            for name in _NUMBERS
            if not _is_reading_within_tolerance(kept[name], now[name], tolerance)
        ]
        if differing:
            wrong += 1
            if wrong <= LIMITS.max_logs:
                item = f"{READINGS}: run '{kept['run_id']}', reading {kept['reading']}"
                what = f"the replay gives a different {', '.join(differing)}"
                checked_bundle.add_finding(BundleOutcome.IRREPRODUCIBLE, item, what)
    if wrong > LIMITS.max_logs:
        checked_bundle.add_finding(
            BundleOutcome.IRREPRODUCIBLE, READINGS, f"and {wrong - LIMITS.max_logs} more readings"
        )


def _is_reading_within_tolerance(
    stored_value: float | None, replayed_value: float | None, tolerance: float
) -> bool:
    if stored_value is None or replayed_value is None:
        return stored_value is replayed_value
    return abs(stored_value - replayed_value) <= tolerance


def find_log_path(
    checked_bundle: CheckedBundle, log: EvidenceLog, paths_by_name: dict[str, list[Path]]
) -> Path | None:
    """Find a log whose files match by name and digest, all in one folder; None if not found."""
    item = f"logs: {log.log}"
    places: list[Path] | None = None
    for file in log.files:
        named = [path for path in paths_by_name.get(file.name, ()) if not path.is_symlink()]
        same = [path.parent for path in named if file_sha256(path) == file.sha256]
        if not same:
            if named:
                what = f"'{file.name}' differs from the file in the evidence"
                checked_bundle.add_finding(BundleOutcome.TAMPERED, item, what)
            else:
                what = (
                    f"'{file.name}' is a link in the folder of logs, and no link is followed; "
                    "copy the log there, or give the folder that it is in"
                    if file.name in paths_by_name
                    else f"'{file.name}' is not in the folder of logs"
                )
                checked_bundle.add_finding(BundleOutcome.INCOMPLETE, item, what)
            return None
        places = same if places is None else [place for place in places if place in same]
    if not places:
        checked_bundle.add_finding(
            BundleOutcome.INCOMPLETE, item, "its files are not together in one folder"
        )
        return None
    # a rosbag2 directory is opened as a whole; its folder may have another name now
    name = log.files[0].name
    is_file = len(log.files) == 1 and Path(log.log).name == name
    return places[0] / name if is_file else places[0]


def _find_files_below_folder_by_name(folder: Path, names: set[str]) -> dict[str, list[Path]]:
    """Find the regular files and links with these names in a folder tree; no link is followed."""
    found: dict[str, list[Path]] = {}
    for number, entry in enumerate(_iter_entries_of_folder_tree(folder, 0)):
        if number >= LIMITS.searched_files:
            raise EvidenceError(
                f"{folder}: has more than {LIMITS.searched_files} entries; give a folder that has "
                "only the logs of the evidence"
            )
        mode = entry.stat(follow_symlinks=False).st_mode
        if entry.name in names and (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
            found.setdefault(entry.name, []).append(Path(entry.path))
    return found


def _iter_entries_of_folder_tree(folder: Path, depth: int) -> "Iterator[os.DirEntry[str]]":
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda each: each.name):
            yield entry
            if depth < LIMITS.searched_depth and entry.is_dir(follow_symlinks=False):
                yield from _iter_entries_of_folder_tree(Path(entry.path), depth + 1)
