"""Check that a campaign accounts for every log in its part of a notary list."""

import datetime as dt
from collections.abc import Iterator, Sequence
from typing import Final

from analysis.calibration.campaign.campaign_plan import NotaryStretch
from recordings.calibration.bundle_folder import NOTARY
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.campaign_faults import parse_creation_time, parse_start_time_of_log
from recordings.calibration.check_outcomes import BundleFinding, BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog
from recordings.notary.notary_check import (
    CheckedNotaryList,
    check_untrusted_notary_list,
    parse_list_time,
)
from recordings.notary.notary_list import NotaryEntry, split_list_into_complete_lines_and_tail
from recordings.signatures.keyring import Keyring
from recordings.signatures.signed_by import SignedBy

_CLOCK: Final = dt.timedelta(seconds=LIMITS.clock_difference_s)


def cut_range_from_notary_list(list_bytes: bytes, list_range: NotaryStretch) -> bytes:
    """Cut the head of a list and the lines of a part of it, for a bundle.

    Args:
        list_bytes: the whole list, checked.
        list_range: counters of the part; lines that are missing are left to the check to find.
    """
    whole, _ = split_list_into_complete_lines_and_tail(list_bytes)
    return b"".join(
        line + b"\n" for line in (*whole[:1], *whole[list_range.first : list_range.last + 1])
    )


def check_notary_list_range(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    list_bytes: bytes | None,
    keyring: Keyring,
) -> None:
    """Check the part of a list in a bundle, and that the campaign agrees with it.

    Args:
        checked_bundle: the bundle; receives findings and notary.
        document: its evidence.
        list_bytes: the part of the list; None without one.
        keyring: keys kept by the user.
    """
    stretch = document.campaign.notary
    if stretch is None:
        if list_bytes is not None:
            checked_bundle.add_finding(
                BundleOutcome.TAMPERED, NOTARY, "is a notary list, but the campaign names none"
            )
        return
    if list_bytes is None:
        checked_bundle.add_finding(
            BundleOutcome.INCOMPLETE, NOTARY, "is missing, although the campaign names it"
        )
        return
    kept = check_untrusted_notary_list(list_bytes, dt.datetime.now(dt.UTC), stretch.first)
    checked_bundle.findings += iter_findings_on_notary_log_list_range(document, stretch, kept)
    reasons = stretch.omission_reason_by_log_number
    checked_bundle.notes += [
        f"{NOTARY}: {each.what} (left out: {reasons[each.counter]})"
        for each in kept.faults
        if not each.forged and each.counter in reasons
    ]
    checked_bundle.notes += [f"{NOTARY}: {note}" for note in kept.notes]
    checked_bundle.notarised_by = identify_notary_signer(checked_bundle, document, kept, keyring)


def iter_findings_on_notary_log_list_range(
    document: EvidenceDocument, list_range: NotaryStretch, checked_list: CheckedNotaryList
) -> Iterator[BundleFinding]:
    """Yield errors in a part of a list, or in the campaign's account of it."""
    for fault in checked_list.faults:
        if fault.forged:
            yield BundleFinding(BundleOutcome.TAMPERED, NOTARY, fault.what)
        elif fault.counter not in list_range.omission_reason_by_log_number:
            yield BundleFinding(BundleOutcome.INCOMPLETE, NOTARY, fault.what)
    if checked_list.head is None:
        return
    machine = document.campaign.machine.id
    if checked_list.head.machine_id not in ("", machine):
        listed_machine = checked_list.head.machine_id
        what = f"is the list of machine '{listed_machine}', but the campaign is for '{machine}'"
        yield BundleFinding(BundleOutcome.TAMPERED, NOTARY, what)
    listed = {entry.counter for entry in checked_list.log_entries}
    for number in range(list_range.first, list_range.last + 1):
        if number not in listed:
            what = f"number {number} is missing, although the campaign names it"
            yield BundleFinding(BundleOutcome.INCOMPLETE, NOTARY, what)
    for what in iter_unaccounted_log_sentences(list_range, document.logs, checked_list.log_entries):
        yield BundleFinding(BundleOutcome.INCOMPLETE, NOTARY, what)
    yield from iter_contradictions_to_notary_list(document, list_range, checked_list.log_entries)


def iter_unaccounted_log_sentences(
    list_range: NotaryStretch, logs: Sequence[EvidenceLog], list_entries: Sequence[NotaryEntry]
) -> Iterator[str]:
    """Yield sentences on logs that are neither used nor omitted, and on used logs without entry."""
    for entry in list_entries:
        if not list_range.first <= entry.counter <= list_range.last:
            yield f"number {entry.counter} is not among the numbers that the campaign names"
        elif entry.counter not in list_range.omission_reason_by_log_number and not any(
            _does_entry_list_all_files_of_log(log, entry) for log in logs
        ):
            yield (
                f"number {entry.counter}, '{entry.log}' of {entry.begins or 'no known time'}, is "
                "neither in the campaign nor left out with a reason"
            )
    for log in logs:
        if not any(_does_entry_list_all_files_of_log(log, entry) for entry in list_entries):
            yield f"{log.log}: is not listed among numbers {list_range.first} to {list_range.last}"


def _does_entry_list_all_files_of_log(log: EvidenceLog, list_entry: NotaryEntry) -> bool:
    """Whether an entry of the list contains every file that was read of a log."""
    return {file.sha256 for file in log.files} <= {file.sha256 for file in list_entry.files}


def iter_contradictions_to_notary_list(
    document: EvidenceDocument, list_range: NotaryStretch, list_entries: Sequence[NotaryEntry]
) -> Iterator[BundleFinding]:
    """Yield findings on contradictions between list and evidence."""
    made, machine = parse_creation_time(document), document.campaign.machine.id
    for entry in list_entries:
        number = entry.counter
        own = next(
            (log for log in document.logs if _does_entry_list_all_files_of_log(log, entry)), None
        )
        listed = parse_list_time(entry.listed)
        assert listed is not None
        said = ""
        if listed > made + _CLOCK:
            said = f"number {number} was listed {entry.listed}, after the evidence was made"
        elif own is not None and number in list_range.omission_reason_by_log_number:
            said = f"number {number} is left out, although {own.log} is a log of the campaign"
        elif own is not None and entry.machine_id not in ("", machine):
            said = (
                f"number {number} is of machine '{entry.machine_id}', the campaign of '{machine}'"
            )
        elif own is not None and not does_log_start_within_list_entry(own, entry):
            said = (
                f"number {number}: {own.log} begins {own.begins}, but the list states "
                f"{entry.begins}"
            )
        if said:
            yield BundleFinding(BundleOutcome.IRREPRODUCIBLE, NOTARY, said)


def does_log_start_within_list_entry(log: EvidenceLog, list_entry: NotaryEntry) -> bool:
    """Whether a log starts between start and end of its entry in the list, if both are known."""
    start, first, last = (
        parse_start_time_of_log(log),
        parse_list_time(list_entry.begins),
        parse_list_time(list_entry.ends),
    )
    if start is None or first is None or last is None:
        return start is None or first is None
    return first - _CLOCK <= start <= last + _CLOCK


def identify_notary_signer(
    checked_bundle: CheckedBundle,
    document: EvidenceDocument,
    checked_list: CheckedNotaryList,
    keyring: Keyring,
) -> SignedBy:
    """Identify the notary by the user's keyring."""
    key = checked_list.notary_public_key
    if key is None or any(fault.forged for fault in checked_list.faults):
        return SignedBy("broken")
    known = keyring.find_key_by_id_or_prefix(key.key_id)
    by = SignedBy("unknown", "", "" if known is None else known.owner, key.key_id, key.base64_text)
    if document.signer is not None and document.signer.key_id == key.key_id:
        checked_bundle.notes.append(
            f"{NOTARY}: signed with the same key as this evidence, so it is no independent proof "
            "of when the logs existed"
        )
    if known is None:
        checked_bundle.notes.append(
            f"{NOTARY}: is {by}: get the key from the keeper of the recorder through another "
            f"channel, and keep it: {by.command_to_add_key}"
        )
        return by
    last = max(
        (parse_list_time(entry.listed) or parse_creation_time(document))
        for entry in checked_list.log_entries
    )
    fault = (
        known.explain_distrust(last.date(), checked_bundle.proven_day)
        if checked_list.log_entries
        else ""
    )
    if fault:
        outcome = BundleOutcome.TAMPERED if known.revoked else BundleOutcome.INCOMPLETE
        checked_bundle.add_finding(
            outcome, NOTARY, f"the key of {known.owner}, {key.key_id[:12]}…, {fault}"
        )
        return by
    return SignedBy("known", "", known.owner, key.key_id, key.base64_text)
