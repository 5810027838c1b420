"""A campaign names a stretch of the recorder's list: every log in it is in the campaign, or left
out with a reason. Here whoever makes the evidence holds its key, and lacks the recorder's."""

import datetime as dt
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from estimators.errors import CampaignError
from recordings.calibration.bundle_folder import NOTARY
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.notary.notary_list import (
    NotaryEntry,
    encode_notary_lines,
    make_signed_line,
    parse_untrusted_line,
)
from recordings.signatures.keyring import KnownKey, add_key_to_keyring, load_keyring
from recordings.signatures.signing import SigningKey, read_public_key_file, read_signing_key_or_none
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.calibration.campaign_file import load_campaign_and_machine
from replay.calibration.refuse_campaign import load_range_of_notary_list
from replay.calibration.verify_bundle import Verification, verify_bundle
from replay.notary.list_file import STATE_VARIABLE
from replay.notary.notarise_folder import notarise_folder
from tests.replay.attacker import Bundle, key_files, sign_with, tampered
from tests.replay.made_evidence import ALIKE, items
from tests.replay.sledge_campaign import campaign_folder
from tests.twins import mark_heavy_after

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf")

TAMPERED, INCOMPLETE = BundleOutcome.TAMPERED, BundleOutcome.INCOMPLETE
IRREPRODUCIBLE = BundleOutcome.IRREPRODUCIBLE
NOON_S = 1777636800.0
LAST = 4
STRETCH = """
[notary]
list = "notary.jsonl"
first = 1
last = 4
left_out = [{ number = 4, reason = "shift work between the runs" }]
"""


class Notarised:
    """A campaign of three logs, a fourth that is none of it, and the list of all four."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.private, self.public = key_files(folder)
        self.recorder, self.recorder_public = key_files(folder, "recorder")
        logs = folder / "logs"
        self.campaign = campaign_folder(
            logs, extra=ALIKE + STRETCH, loads=(0, 1, 2), begin_unix_s=NOON_S
        )
        shutil.copy(logs / "load-2.csv", logs / "shift.csv")
        with (logs / "shift.csv").open("a") as log:
            log.write(f"{NOON_S + 3 * 86400.0},0.0,0.0,0.0\n")
        for day, name in enumerate(("load-0.csv", "load-1.csv", "load-2.csv", "shift.csv")):
            at = NOON_S + 86400.0 * day + 60.0
            os.utime(logs / name, (at, at))
        self.list = notarise_folder(logs, key_file=self.recorder, machine_id="sledge-7").path
        self.bundle = folder / "evidence"
        calibrate_from_campaign(self.campaign, self.bundle, key_file=self.private)

    def verify(self, folder: Path, **more: Any) -> Verification:
        return verify_bundle(folder, key_file=self.public, **more)


@pytest.fixture(scope="module")
def notarised(tmp_path_factory: pytest.TempPathFactory) -> Notarised:
    folder = tmp_path_factory.mktemp("notarised")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(STATE_VARIABLE, str(folder / "state"))
        return Notarised(folder)


@pytest.fixture(autouse=True)
def keyring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PAYSCOPE_KEYRING", str(tmp_path / "keys.toml"))


@pytest.mark.heavy
def test_every_log_between_is_accounted_for_and_that_is_said(notarised: Notarised) -> None:
    found = notarised.verify(notarised.bundle)
    assert not found.findings, items(found)
    done = "\n".join(found.checks_made)
    assert "the recorder's list, number 1 to 4: signatures, chain, and each log" in done
    assert "signed by an unknown key" in done
    unseen = "\n".join(found.unverifiable_statements)
    assert "does not have between number 1 and 4: by a second recorder" in unseen
    assert "nothing in a bundle shows that it was ever made" not in unseen
    assert "Left out: 4: shift work between the runs" in (
        notarised.bundle / "report.html"
    ).read_text(encoding="utf-8")


def test_a_required_signature_asks_for_a_known_recorder_as_well(notarised: Notarised) -> None:
    found = notarised.verify(notarised.bundle, is_signature_required=True)
    assert found.outcome is INCOMPLETE
    assert "notary.jsonl: is signed by an unknown key" in items(found)
    key = read_public_key_file(notarised.recorder_public).base64_text
    add_key_to_keyring(load_keyring(), KnownKey(key=key, owner="Recorder 7"))
    found = notarised.verify(notarised.bundle, is_signature_required=True)
    assert not found.findings
    assert "signed by Recorder 7" in "\n".join(found.checks_made)


def test_the_list_of_a_revoked_recorder_counts_for_nothing(notarised: Notarised) -> None:
    key = KnownKey(
        key=read_public_key_file(notarised.recorder_public).base64_text,
        owner="Recorder 7",
        revoked=dt.date(2026, 6, 1),
    )
    add_key_to_keyring(load_keyring(), key)
    found = notarised.verify(notarised.bundle)
    assert found.outcome is TAMPERED
    assert "notary.jsonl: the key of Recorder 7" in items(found)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("last = 4", "last = 9", "notary.last is 9, but .* ends at number 4"),
        ("first = 1", "first = 5", r"notary: last \(4\) is before first \(5\); correct one"),
        ("number = 4", "number = 7", "number 7 in left_out is not between first and last"),
        ('reason = "shift work between the runs"', 'reason = ""', "notary.left_out.*reason"),
        ('list = "notary.jsonl"', 'list = "none.jsonl"', "none.jsonl: cannot be read"),
    ],
)
def test_a_stretch_that_cannot_be_is_refused(
    notarised: Notarised, tmp_path: Path, old: str, new: str, words: str
) -> None:
    folder = Path(shutil.copytree(notarised.campaign.parent, tmp_path / "logs"))
    campaign = folder / notarised.campaign.name
    campaign.write_text(campaign.read_text().replace(old, new))
    with pytest.raises(CampaignError, match=words):
        load_range_of_notary_list(campaign, load_campaign_and_machine(campaign)[0])


def test_a_campaign_that_leaves_a_log_out_is_refused(notarised: Notarised, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(notarised.campaign.parent, tmp_path / "logs"))
    campaign = folder / notarised.campaign.name
    text = campaign.read_text()
    campaign.write_text(text.partition("left_out")[0])
    with pytest.raises(CampaignError, match=r"number 4, 'shift.csv' of 2026-05-03.* neither in"):
        calibrate_from_campaign(campaign, tmp_path / "evidence")
    assert not (tmp_path / "evidence").exists()


def lines_of(data: bytes) -> list[bytes]:
    return data.splitlines(keepends=True)


def without(number: int) -> Callable[[bytes], bytes]:
    return lambda data: b"".join(line for k, line in enumerate(lines_of(data)) if k != number)


def of_bytes(change: Callable[[bytes], bytes]) -> Callable[[Bundle], None]:
    def tamper(bundle: Bundle) -> None:
        bundle.bytes_of[NOTARY] = change

    return tamper


def in_campaign(**values: Any) -> Callable[[Bundle], None]:
    def tamper(bundle: Bundle) -> None:
        bundle.evidence["campaign"]["notary"] |= values

    return tamper


def both(*tampers: Callable[[Bundle], None]) -> Callable[[Bundle], None]:
    def tamper(bundle: Bundle) -> None:
        for each in tampers:
            each(bundle)

    return tamper


def not_named(bundle: Bundle) -> None:
    del bundle.evidence["campaign"]["notary"]


def gone(bundle: Bundle) -> None:
    (bundle.folder / NOTARY).unlink()


def forged_before_its_logs(bundle: Bundle) -> None:
    bundle.evidence["made"] = "2026-05-05T00:00:00Z"


def swapped(data: bytes) -> bytes:
    lines = lines_of(data)
    lines[2], lines[3] = lines[3], lines[2]
    return b"".join(lines)


LEFT_OUT = {"number": 4, "reason": "x"}
#: What whoever holds the signer's key does to evidence: the change, its outcome and the words.
ATTACKS: dict[str, tuple[Callable[[Bundle], None], BundleOutcome | None, str]] = {
    "a reason taken out": (in_campaign(left_out=[]), INCOMPLETE, "number 4, 'shift.csv'"),
    "the log's line dropped": (of_bytes(without(4)), INCOMPLETE, "number 4 is missing"),
    "an inner line dropped": (of_bytes(without(2)), TAMPERED, "number 2 is missing"),
    "line and number dropped": (
        both(of_bytes(without(4)), in_campaign(last=3, left_out=[])), None, "",
    ),
    "an inner line and a narrower stretch": (
        both(of_bytes(without(1)), in_campaign(first=2)),
        INCOMPLETE,
        "load-0.csv: is not listed among numbers 2 to 4",
    ),
    "a narrower stretch alone": (
        in_campaign(first=2), TAMPERED, "out of order, or twice",
    ),
    "a run's log left out": (
        in_campaign(left_out=[LEFT_OUT, {"number": 2, "reason": "x"}]),
        IRREPRODUCIBLE,
        "number 2 is left out, although load-1.csv is a log of the campaign",
    ),
    "lines swapped": (of_bytes(swapped), TAMPERED, "out of order"),
    "the head dropped": (of_bytes(without(0)), TAMPERED, "first line is not the head"),
    "a torn tail": (of_bytes(lambda data: data[:-9]), INCOMPLETE, "is truncated"),
    "another digest": (
        of_bytes(lambda data: data.replace(b'"sha256":"', b'"sha256":"f', 1)), TAMPERED, "sha256",
    ),
    "another machine": (
        of_bytes(lambda data: data.replace(b"sledge-7", b"sledge-8", 1)), TAMPERED, "not signed",
    ),
    "empty": (of_bytes(lambda _: b""), TAMPERED, "first line is not the head"),
    "taken away": (gone, INCOMPLETE, "notary.jsonl: is missing"),
    "not named": (not_named, TAMPERED, "is a notary list, but the campaign names none"),
    "made before it was listed": (
        forged_before_its_logs, IRREPRODUCIBLE, "after the evidence was made",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", mark_heavy_after(1, ATTACKS))
def test_what_is_done_to_a_stretch_is_found_though_the_evidence_is_signed_anew(
    name: str, notarised: Notarised, tmp_path: Path
) -> None:
    change, outcome, words = ATTACKS[name]
    found = notarised.verify(resigned(notarised, tmp_path, change))
    if outcome is None:  # the list ends before the log: what came later is said not to be known
        assert "between number 1 and 3" in "\n".join(found.unverifiable_statements)
        return
    assert outcome in {each.outcome for each in found.findings}, items(found)
    assert words in items(found)


def resigned(notarised: Notarised, tmp_path: Path, change: Callable[[Bundle], None]) -> Path:
    key = read_signing_key_or_none(notarised.private)
    assert key is not None

    def tamper(bundle: Bundle) -> None:
        change(bundle)
        sign_with(bundle, key)

    return tampered(notarised.bundle, tmp_path / "b", tamper, signed=True)


def relisted(key: SigningKey, **values: Any) -> Callable[[bytes], bytes]:
    """The list made anew by another key, or by a thief of the recorder's."""

    def change(data: bytes) -> bytes:
        head, *rest = (parse_untrusted_line(line, "line") for line in data.splitlines())
        made = [
            make_signed_line(
                head.content.model_copy(update={"public_key": key.public_key.base64_text}), key
            )
        ]
        for line in rest:
            more = {"head": made[0].line_sha256, "previous": made[-1].line_sha256, **values}
            content = line.content.model_dump(mode="json") | more
            made.append(make_signed_line(NotaryEntry.model_validate(content), key))
        return encode_notary_lines(made)

    return change


def test_a_list_by_a_key_of_ones_own_is_no_recorders(notarised: Notarised, tmp_path: Path) -> None:
    own = read_signing_key_or_none(notarised.private)
    assert own is not None
    add_key_to_keyring(
        load_keyring(),
        KnownKey(
            key=read_public_key_file(notarised.recorder_public).base64_text, owner="Recorder 7"
        ),
    )
    forged = resigned(notarised, tmp_path, of_bytes(relisted(own)))
    found = notarised.verify(forged, is_signature_required=True)
    assert found.outcome is INCOMPLETE
    assert "is signed by an unknown key" in items(found)
    assert any("signed with the same key as this evidence" in note for note in found.notes)


def test_a_line_that_names_another_machine_is_none_of_the_campaign(
    notarised: Notarised, tmp_path: Path
) -> None:
    """Test: by a thief of the recorder's key. Expected Result: found by what logs contradict."""
    key = read_signing_key_or_none(notarised.recorder)
    assert key is not None
    forged = resigned(notarised, tmp_path, of_bytes(relisted(key, machine_id="sledge-8")))
    found = notarised.verify(forged)
    assert found.outcome is IRREPRODUCIBLE
    assert "number 1 is of machine 'sledge-8', the campaign of 'sledge-7'" in items(found)


def test_a_line_of_another_time_than_its_log_is_found(notarised: Notarised, tmp_path: Path) -> None:
    key = read_signing_key_or_none(notarised.recorder)
    assert key is not None
    times = {"begins": "2026-04-01T12:00:00Z", "ends": "2026-04-01T12:01:00Z"}
    forged = resigned(notarised, tmp_path, of_bytes(relisted(key, **times)))
    found = notarised.verify(forged)
    assert found.outcome is IRREPRODUCIBLE
    assert "load-0.csv begins 2026-05-01 12:00:00 UTC, but the list states 2026-04-01" in items(
        found
    )
