"""The command `verify` on a notary's list."""

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimators.errors import EvidenceError, counted
from recordings.calibration.check_outcomes import (
    BundleFinding,
    BundleOutcome,
    most_severe_outcome,
    verdict_text,
)
from recordings.notary.notary_check import check_notary_list
from recordings.notary.notary_list import MOST_LIST_BYTES
from recordings.signatures.keyring import load_keyring
from recordings.signatures.signed_by import SignedBy
from recordings.signatures.signing import read_public_key

#: What no check of a list can find.
UNSEEN = (
    "A log of a second recorder, or of another folder.",
    "A log that was deleted before it ended, or before the notary looked.",
    "A list that was truncated or rewritten by whoever has a copy of its key, before evidence "
    "named its later numbers. The notary detects a truncated list by its second copy of the end.",
    "Whether the clocks of recorder and notary were right: only a time stamp of evidence proves a "
    "time from outside.",
)


@dataclass(frozen=True, slots=True)
class VerifiedList:
    """Result of verifying a list.

    Attributes:
        path: path of the list.
        findings: faults of the list.
        notes: further notes for the reader.
        logs: number of logs.
        kept_by: owner of the key.
    """

    path: Path
    findings: tuple[BundleFinding, ...]
    notes: tuple[str, ...]
    logs: int
    kept_by: SignedBy

    @property
    def outcome(self) -> BundleOutcome | None:
        """Exit status; None if nothing is wrong."""
        return most_severe_outcome(self.findings)

    @property
    def verdict(self) -> str:
        """Outcome in one sentence."""
        holds = f"{counted(self.logs, 'log')} verified; {self.kept_by}"
        return verdict_text(self.path, self.findings, holds)

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain values."""
        return {
            "list": str(self.path),
            "outcome": 0 if self.outcome is None else int(self.outcome),
            "findings": [
                {"kind": each.kind, "item": each.item, "what": each.what} for each in self.findings
            ],
            "notes": list(self.notes),
            "logs": self.logs,
            "no_check_can_find": list(UNSEEN),
        }


def verify_notary_list(
    path: Path, *, key_file: Path | None = None, signed: bool = False
) -> VerifiedList:
    """Check a list on its own, without the logs.

    Args:
        path: path of the list.
        key_file: public key of the recorder.
        signed: whether the list must be signed with that key, or one of the user's keyring.

    Raises:
        EvidenceError: it, or the key, cannot be read.
    """
    key = None if key_file is None else read_public_key(key_file)
    try:
        with path.open("rb") as file:
            data = file.read(MOST_LIST_BYTES + 1)
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from None
    kept = check_notary_list(data, dt.datetime.now(dt.UTC))
    findings = [
        BundleFinding(
            BundleOutcome.TAMPERED if fault.forged else BundleOutcome.INCOMPLETE,
            path.name,
            fault.what,
        )
        for fault in kept.faults
    ]
    own = kept.key
    by = SignedBy("broken")
    if own is not None and not any(fault.forged for fault in kept.faults):
        known = load_keyring().find_key_or_none(own.key_id)
        how = "known" if known is not None else "unknown"
        by = SignedBy(how, "", "" if known is None else known.owner, own.key_id, own.text)
        if key is not None and key.key_id == own.key_id:
            by = SignedBy("given", "", by.owner, own.key_id, own.text)
        elif known is not None:
            last = kept.entries[-1].listed if kept.entries else kept.head.begun if kept.head else ""
            fault = known.distrust_reason(dt.datetime.fromisoformat(last).date(), None)
            if fault:
                what = f"the key of {known.owner}, {own.key_id[:12]}…, {fault}"
                outcome = BundleOutcome.TAMPERED if known.revoked else BundleOutcome.INCOMPLETE
                findings.append(BundleFinding(outcome, path.name, what))
    if key is not None and own is not None and key.key_id != own.key_id:
        what = f"is not kept with the key {key.key_id[:12]}… given"
        findings.append(BundleFinding(BundleOutcome.TAMPERED, path.name, what))
    elif signed and not by.is_trusted and not findings:
        what = f"is {by}, but a signature by a known key is required"
        findings.append(BundleFinding(BundleOutcome.INCOMPLETE, path.name, what))
    return VerifiedList(path, tuple(findings), tuple(kept.notes), len(kept.lines), by)
