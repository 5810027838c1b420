"""Check that a campaign accounts for every log in its part of a notary list."""

import datetime as dt
from collections.abc import Iterator, Sequence
from typing import Final

from analysis.calibration.campaign.campaign_plan import NotaryStretch
from recordings.calibration.bundle_folder import NOTARY
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.campaign_faults import parse_creation_time, parse_log_begin
from recordings.calibration.check_outcomes import BundleFinding, BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceLog
from recordings.notary.notary_check import CheckedList, check_notary_list, parse_list_time
from recordings.notary.notary_list import NotaryEntry, split_whole_lines
from recordings.signatures.keyring import Keyring
from recordings.signatures.signed_by import SignedBy

_CLOCK: Final = dt.timedelta(seconds=LIMITS.clock_difference_s)


def cut_notary_stretch(data: bytes, stretch: NotaryStretch) -> bytes:
    """Head of a list and the lines of a part of it, for a bundle.

    Args:
        data: the whole list, checked.
        stretch: counters of the part; missing lines are found by the check.
    """
    whole, _ = split_whole_lines(data)
    return b"".join(line + b"\n" for line in (*whole[:1], *whole[stretch.first : stretch.last + 1]))


def check_notary_stretch(
    bundle: CheckedBundle, document: EvidenceDocument, data: bytes | None, keyring: Keyring
) -> None:
    """Check the part of a list in a bundle, and that its campaign agrees with it.

    Args:
        bundle: the bundle; receives findings and notary.
        document: its evidence.
        data: the part of the list; None without one.
        keyring: keys kept by the user.
    """
    stretch = document.campaign.notary
    if stretch is None:
        if data is not None:
            bundle.add_finding(
                BundleOutcome.TAMPERED, NOTARY, "is a list, but the campaign names none"
            )
        return
    if data is None:
        bundle.add_finding(
            BundleOutcome.INCOMPLETE, NOTARY, "is missing, although the campaign names it"
        )
        return
    kept = check_notary_list(data, dt.datetime.now(dt.UTC), stretch.first)
    bundle.findings += find_stretch_faults(document, stretch, kept)
    reasons = stretch.omission_reasons_by_log
    bundle.notes += [
        f"{NOTARY}: {each.what} (left out: {reasons[each.counter]})"
        for each in kept.faults
        if not each.forged and each.counter in reasons
    ]
    bundle.notes += [f"{NOTARY}: {note}" for note in kept.notes]
    bundle.notarised_by = identify_notary_signer(bundle, document, kept, keyring)


def find_stretch_faults(
    document: EvidenceDocument, stretch: NotaryStretch, checked_list: CheckedList
) -> Iterator[BundleFinding]:
    """Yield errors in a part of a list, or in the campaign's account of it."""
    for fault in checked_list.faults:
        if fault.forged:
            yield BundleFinding(BundleOutcome.TAMPERED, NOTARY, fault.what)
        elif fault.counter not in stretch.omission_reasons_by_log:
            yield BundleFinding(BundleOutcome.INCOMPLETE, NOTARY, fault.what)
    if checked_list.head is None:
        return
    machine = document.campaign.machine.id
    if checked_list.head.machine_id not in ("", machine):
        listed_machine = checked_list.head.machine_id
        what = f"is the list of machine '{listed_machine}', but the campaign is for '{machine}'"
        yield BundleFinding(BundleOutcome.TAMPERED, NOTARY, what)
    listed = {entry.counter for entry in checked_list.entries}
    for number in range(stretch.first, stretch.last + 1):
        if number not in listed:
            what = f"number {number} is missing, although the campaign names it"
            yield BundleFinding(BundleOutcome.INCOMPLETE, NOTARY, what)
    for what in find_unaccounted_logs(stretch, document.logs, checked_list.entries):
        yield BundleFinding(BundleOutcome.INCOMPLETE, NOTARY, what)
    yield from find_notary_contradictions(document, stretch, checked_list.entries)


def find_unaccounted_logs(
    stretch: NotaryStretch, logs: Sequence[EvidenceLog], entries: Sequence[NotaryEntry]
) -> Iterator[str]:
    """Yield logs that are neither used nor left out, and used logs without a line."""
    for entry in entries:
        if not stretch.first <= entry.counter <= stretch.last:
            yield f"number {entry.counter} is not among the numbers that the campaign names"
        elif entry.counter not in stretch.omission_reasons_by_log and not any(
            _is_entry_of_log(log, entry) for log in logs
        ):
            yield (
                f"number {entry.counter}, '{entry.log}' of {entry.begins or 'no known time'}, is "
                "neither in the campaign nor left out with a reason"
            )
    for log in logs:
        if not any(_is_entry_of_log(log, entry) for entry in entries):
            yield f"{log.log}: is not listed among numbers {stretch.first} to {stretch.last}"


def _is_entry_of_log(log: EvidenceLog, entry: NotaryEntry) -> bool:
    """Whether a line is of this log: its files include all that were read."""
    return {file.sha256 for file in log.files} <= {file.sha256 for file in entry.files}


def find_notary_contradictions(
    document: EvidenceDocument, stretch: NotaryStretch, entries: Sequence[NotaryEntry]
) -> Iterator[BundleFinding]:
    """Yield contradictions between list and evidence."""
    made, machine = parse_creation_time(document), document.campaign.machine.id
    for entry in entries:
        number = entry.counter
        own = next((log for log in document.logs if _is_entry_of_log(log, entry)), None)
        listed = parse_list_time(entry.listed)
        assert listed is not None
        said = ""
        if listed > made + _CLOCK:
            said = f"number {number} was listed {entry.listed}, after the evidence was made"
        elif own is not None and number in stretch.omission_reasons_by_log:
            said = f"number {number} is left out, although {own.log} is a log of the campaign"
        elif own is not None and entry.machine_id not in ("", machine):
            said = f"number {number} names machine '{entry.machine_id}', the campaign '{machine}'"
        elif own is not None and not does_log_begin_within_entry(own, entry):
            said = (
                f"number {number}: {own.log} begins {own.begins}, but the list states "
                f"{entry.begins}"
            )
        if said:
            yield BundleFinding(BundleOutcome.IRREPRODUCIBLE, NOTARY, said)


def does_log_begin_within_entry(log: EvidenceLog, entry: NotaryEntry) -> bool:
    """Whether a log begins within the time of its line."""
    begin, first, last = (
        parse_log_begin(log),
        parse_list_time(entry.begins),
        parse_list_time(entry.ends),
    )
    if begin is None or first is None or last is None:
        return begin is None or first is None
    return first - _CLOCK <= begin <= last + _CLOCK


def identify_notary_signer(
    bundle: CheckedBundle, document: EvidenceDocument, checked_list: CheckedList, keyring: Keyring
) -> SignedBy:
    """Identity of the notary, by the user's keyring."""
    key = checked_list.key
    if key is None or any(fault.forged for fault in checked_list.faults):
        return SignedBy("broken")
    known = keyring.find_key(key.key_id)
    by = SignedBy("unknown", "", "" if known is None else known.owner, key.key_id, key.text)
    if document.signer is not None and document.signer.key_id == key.key_id:
        bundle.notes.append(
            f"{NOTARY}: signed with the same key as this evidence, so it is no independent proof "
            "of when the logs existed"
        )
    if known is None:
        bundle.notes.append(
            f"{NOTARY}: is {by}: get the key from the keeper of the recorder through another "
            f"channel, and keep it: {by.add_key_command}"
        )
        return by
    last = max(
        (parse_list_time(entry.listed) or parse_creation_time(document))
        for entry in checked_list.entries
    )
    fault = known.distrust_reason(last.date(), bundle.proven_day) if checked_list.entries else ""
    if fault:
        outcome = BundleOutcome.TAMPERED if known.revoked else BundleOutcome.INCOMPLETE
        bundle.add_finding(
            outcome, NOTARY, f"the key of {known.owner}, {key.key_id[:12]}…, {fault}"
        )
        return by
    return SignedBy("known", "", known.owner, key.key_id, key.text)
