"""Whose signature it is: a name in evidence is worth nothing, a key that the user knows is."""

import base64
import datetime as dt
import json
import os
import pty
import select
import subprocess
import sys
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from estimators.errors import EvidenceError
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.signatures.canonical_json import encode_canonical_json
from recordings.signatures.keyring import KnownKey, add_key_to_keyring, load_keyring
from recordings.signatures.signing import (
    PublicKey,
    describe_key_weakness,
    read_public_key_file,
    read_signing_key_or_none,
)
from replay.calibration.apply_evidence import CalibrationRequest, load_and_verify_calibration
from replay.calibration.calibrate_campaign import (
    calibrate_from_campaign,
    read_previous_evidence,
)
from replay.calibration.verify_bundle import verify_bundle
from replay.fleet.machine_setups import NamedFiles, make_setups_of_machine
from tests.conftest import REPO
from tests.replay.attacker import Bundle, key_files, sign_with_own_key, tampered
from tests.replay.made_evidence import Made, items
from tests.replay.sledge import Payscope, join_to_one_line

pytestmark = pytest.mark.usefixtures("kept_replays")

PTB = "PTB Braunschweig, K-1.24"
P = 2**255 - 19


@pytest.fixture
def keyring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "config" / "keys.toml"
    monkeypatch.setenv("PAYSCOPE_KEYRING", str(path))
    return path


@pytest.fixture
def invented(made: Made, tmp_path: Path) -> Path:
    """Evidence made anew by a stranger, with a key of his own and a name that is not his."""

    def forge(bundle: Bundle) -> None:
        bundle.evidence["signer"]["name"] = PTB
        bundle.evidence["campaign"]["campaign"]["signer"] = PTB
        sign_with_own_key(bundle)

    return tampered(made.bundle, tmp_path / "forged", forge, signed=True)


def known(made: Made, **more: object) -> KnownKey:
    key = read_public_key_file(made.public).base64_text
    return KnownKey.model_validate({"key": key, "owner": "Test lab", **more})


def test_an_invented_name_is_never_printed_as_that_of_the_signer(
    invented: Path, payscope: Payscope, keyring: Path
) -> None:
    assert not keyring.exists()
    said = payscope("verify", invented)
    assert f"signed by {PTB}" not in said.out
    assert f"signed by an unknown key {public_id(invented)[:12]}… that calls itself '{PTB}'" in (
        said.out
    )
    assert (
        load_and_verify_calibration(CalibrationRequest(invented))
        .describe_calibration_in_sentence("")
        .count("an unknown key")
        == 1
    )


def public_id(folder: Path) -> str:
    return verify_bundle(folder).signed_by.key_id


def test_a_required_signature_is_one_by_a_known_key(
    invented: Path, made: Made, keyring: Path, payscope: Payscope
) -> None:
    with pytest.raises(EvidenceError, match=r"unknown key.*payscope keys add"):
        load_and_verify_calibration(CalibrationRequest(invented, is_signature_required=True))
    said = payscope("verify", invented, "--require-signed")
    assert said.status == 5
    assert "a signature by a known key is required" in said.out
    add_key_to_keyring(load_keyring(), known(made))
    held = load_and_verify_calibration(CalibrationRequest(made.bundle, is_signature_required=True))
    assert "signed by Test lab, key" in held.describe_calibration_in_sentence("")
    assert "that calls itself 'T. Signer'" in held.describe_calibration_in_sentence("")
    assert verify_bundle(made.bundle, is_signature_required=True).outcome is None
    assert verify_bundle(invented, is_signature_required=True).outcome is BundleOutcome.INCOMPLETE
    assert keyring.stat().st_mode & 0o077 == 0


def test_the_line_that_refuses_a_key_adds_it(made: Made, keyring: Path, payscope: Payscope) -> None:
    with pytest.raises(EvidenceError) as refused:
        load_and_verify_calibration(CalibrationRequest(made.bundle, is_signature_required=True))
    line = str(refused.value).partition("payscope keys add ")[2]
    key, _, _ = line.partition(" --owner")
    assert payscope("keys", "add", key, "--owner", "Test lab").status == 0
    request = CalibrationRequest(made.bundle, is_signature_required=True)
    assert load_and_verify_calibration(request).signed_by.how == "known"
    assert "Test lab" in payscope("keys", "list").out
    join_to_one_line(
        payscope("keys", "add", made.public, "--owner", "Another"),
        "already contains key",
        "of Test lab",
    )
    assert keyring.exists()


@pytest.mark.heavy
def test_the_first_use_of_a_key_is_asked_on_a_terminal_and_remembered(
    made: Made, keyring: Path
) -> None:
    """Test: the owner typed at a terminal. Expected Result: kept, and not asked again."""
    code = (
        "from pathlib import Path\n"
        "from replay.commands.common_options import make_calibration_request\n"
        "from replay.calibration.apply_evidence import load_and_verify_calibration\n"
        f"bundle = Path({str(made.bundle)!r})\n"
        "asked = make_calibration_request(bundle, None, is_signature_required=True)\n"
        "print('FOUND', load_and_verify_calibration(asked).signed_by)\n"
    )
    first = at_a_terminal(code, "Test lab\n")
    assert "that calls itself 'T. Signer'" in first
    assert "Who owns this key?" in first
    assert "FOUND signed by Test lab, key" in first
    assert load_keyring().keys[0].owner == "Test lab"
    again = at_a_terminal(code, "")
    assert "Who owns this key?" not in again
    assert "FOUND signed by Test lab, key" in again
    keyring.unlink()
    assert "FOUND" not in at_a_terminal(code, "\n")
    assert not keyring.exists()


def at_a_terminal(code: str, typed: str) -> str:
    """What a program prints whose stdin and stderr are a terminal."""
    ours, its = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        stdin=its,
        stdout=its,
        stderr=its,
        env={**os.environ, "PYTHONPATH": str(REPO)},
    )
    os.close(its)
    os.write(ours, typed.encode())
    seen = b""
    while child.poll() is None or select.select([ours], [], [], 0)[0]:
        if select.select([ours], [], [], 0.2)[0]:
            try:
                seen += os.read(ours, 4096)
            except OSError:
                break
    child.wait()
    os.close(ours)
    return seen.decode()


@pytest.mark.usefixtures("keyring")
def test_a_fleet_asks_nobody_and_refuses_an_unknown_key(invented: Path, made: Made) -> None:
    files = NamedFiles(str(made.campaign.with_name("sledge.toml")), (), (str(invented),))
    with pytest.raises(EvidenceError, match=r"unknown key.*payscope keys add"):
        make_setups_of_machine("sledge", files, is_unfit_evidence_skipped=False)
    add_key_to_keyring(load_keyring(), known(made))
    files = NamedFiles(str(made.campaign.with_name("sledge.toml")), (), (str(made.bundle),))
    assert len(make_setups_of_machine("sledge", files, is_unfit_evidence_skipped=False)) == 2


@pytest.mark.usefixtures("keyring")
def test_nothing_is_chained_to_evidence_by_an_unknown_key(
    invented: Path, made: Made, tmp_path: Path
) -> None:
    own, _ = key_files(tmp_path, "other")
    with pytest.raises(EvidenceError, match="so its signature cannot be verified"):
        read_previous_evidence(invented, None, read_signing_key_or_none(own))
    with pytest.raises(EvidenceError, match="its signature cannot be verified"):
        read_previous_evidence(made.bundle, None, read_signing_key_or_none(own))
    read_previous_evidence(made.bundle, None, read_signing_key_or_none(made.private))
    add_key_to_keyring(load_keyring(), known(made))
    read_previous_evidence(made.bundle, None, read_signing_key_or_none(own))


@pytest.mark.usefixtures("keyring")
@pytest.mark.parametrize(
    ("more", "outcome", "words"),
    [
        ({"valid_to": "2020-01-01"}, BundleOutcome.INCOMPLETE, "was valid to 2020-01-01 only"),
        ({"valid_from": "2999-01-01"}, BundleOutcome.INCOMPLETE, "is valid from 2999-01-01 only"),
        (
            {"revoked": "2999-01-01", "because": "lost disk"},
            BundleOutcome.TAMPERED,
            "was revoked on 2999-01-01 (lost disk): whoever has had it since then can backdate",
        ),
    ],
)
def test_a_key_out_of_its_validity_or_revoked_signs_nothing(
    made: Made, more: dict[str, object], outcome: BundleOutcome, words: str
) -> None:
    add_key_to_keyring(load_keyring(), known(made, **more))
    found = verify_bundle(made.bundle)
    assert found.outcome is outcome
    assert words in items(found)
    assert not found.signed_by.is_trusted
    with pytest.raises(EvidenceError, match="cannot be used to calibrate"):
        load_and_verify_calibration(CalibrationRequest(made.bundle, is_signature_required=True))


def test_a_revoked_key_counts_where_a_time_stamp_is_older(made: Made) -> None:
    key = known(made, revoked="2026-06-01")
    assert key.explain_distrust(dt.date(2026, 5, 1), None)
    assert key.explain_distrust(dt.date(2026, 5, 1), dt.date(2026, 7, 1))
    assert not key.explain_distrust(dt.date(2026, 5, 1), dt.date(2026, 5, 2))


def test_keys_are_revoked_from_the_command_line(
    made: Made, keyring: Path, payscope: Payscope
) -> None:
    payscope("keys", "add", made.public, "--owner", "Test lab", "--valid-from", "2026-01-01")
    key_id = read_public_key_file(made.public).key_id
    said = payscope("keys", "revoke", key_id[:12], "--day", "2026-06-01", "--because", "lost")
    assert said.status == 0
    (held,) = load_keyring().keys
    assert (held.revoked, held.because) == (dt.date(2026, 6, 1), "lost")
    assert held.valid_from == dt.date(2026, 1, 1)
    join_to_one_line(payscope("keys", "revoke", "0123"), "no key '0123'")
    assert keyring.exists()


def test_a_revocation_moves_to_no_later_day_and_keeps_its_reason(
    made: Made, keyring: Path, payscope: Payscope
) -> None:
    held = add_key_to_keyring(load_keyring(), known(made, revoked="2026-06-01", because="lost"))
    key_id = held.keys[0].public_key.key_id[:12]
    join_to_one_line(
        payscope("keys", "revoke", key_id), f"{keyring}: key {key_id}… of Test lab was revoked on"
    )
    assert load_keyring().keys == held.keys
    assert payscope("keys", "revoke", key_id, "--day", "2026-05-01").status == 0
    (earlier,) = load_keyring().keys
    assert (earlier.revoked, earlier.because) == (dt.date(2026, 5, 1), "lost")


def test_a_text_that_a_keyring_cannot_hold_is_refused_in_one_line_and_changes_nothing(
    made: Made, keyring: Path, payscope: Payscope
) -> None:
    for owner in ("A" * 201, "A\nB"):
        join_to_one_line(payscope("keys", "add", made.public, "--owner", owner), "owner: ")
    held = add_key_to_keyring(load_keyring(), known(made))
    key_id = held.keys[0].public_key.key_id[:12]
    said = payscope("keys", "revoke", key_id, "--because", "A" * 201)
    join_to_one_line(said, f"{keyring}: key {key_id}: because: ")
    assert load_keyring().keys == held.keys


def test_a_keyring_that_is_a_link_is_changed_where_it_is_kept(made: Made, keyring: Path) -> None:
    kept = keyring.with_name("shared.toml")
    kept.parent.mkdir()
    kept.touch()
    keyring.symlink_to(kept)
    add_key_to_keyring(load_keyring(), known(made))
    assert keyring.is_symlink()
    assert len(load_keyring(kept).keys) == 1


@pytest.mark.usefixtures("keyring")
@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"revoked": "2026-06-01", "because": "lost disk"}, "was revoked on 2026-06-01"),
        ({"valid_to": "2026-06-01"}, "was valid to 2026-06-01 only"),
    ],
)
def test_a_key_that_the_keyring_does_not_trust_signs_no_evidence(
    made: Made, tmp_path: Path, more: dict[str, object], words: str
) -> None:
    """Test: calibrate, with the key revoked or expired. Expected: no replay, no evidence."""
    add_key_to_keyring(load_keyring(), known(made, **more))
    with pytest.raises(EvidenceError, match=f"^{made.private}: .*{words}.*sign with another key$"):
        calibrate_from_campaign(made.campaign, tmp_path / "evidence", key_file=made.private)
    assert not (tmp_path / "evidence").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[keys]]\nkey = 3", "key"),
        ("[[keys]]\nkey = 'AA=='\nowner = 'x'", "32 bytes"),
        ("[[keys]]\nowner = 'x'", "key"),
        ("keys = 3", "is not a keyring"),
        ("more = 3", "is not a keyring"),
        ("[[keys]", "is not valid TOML"),
    ],
)
def test_a_damaged_keyring_is_refused_in_one_line(
    keyring: Path, payscope: Payscope, text: str, words: str
) -> None:
    keyring.parent.mkdir()
    keyring.write_text(text)
    join_to_one_line(payscope("keys", "list"), str(keyring), words)


SMALL_ORDER = {
    "the identity": 1,
    "order 2": P - 1,
    "order 4": 0,
    "order 8": 0x05FC536D880238B13933C6D305ACDFD5F098EFF289F4C345B027B2C28F95E826,
    "order 8, negative": P - 0x05FC536D880238B13933C6D305ACDFD5F098EFF289F4C345B027B2C28F95E826,
    "order 4, not canonical": P,
    "the identity, not canonical": P + 1,
    "no point": 2,
}


@pytest.mark.parametrize("name", SMALL_ORDER)
@pytest.mark.parametrize("sign", [0, 1 << 255])
def test_a_key_that_anyone_can_sign_for_is_refused(
    name: str, sign: int, tmp_path: Path, payscope: Payscope
) -> None:
    raw = (SMALL_ORDER[name] | sign).to_bytes(32, "little")
    with pytest.raises(EvidenceError, match="weak key"):
        PublicKey.from_base64_text(PublicKey(raw).base64_text)
    join_to_one_line(
        payscope("keys", "add", PublicKey(raw).base64_text, "--owner", "x"), "weak key"
    )
    header = bytes.fromhex("302a300506032b6570032100")
    pem = tmp_path / "key.pub.pem"
    body = base64.b64encode(header + raw).decode()
    pem.write_text(f"-----BEGIN PUBLIC KEY-----\n{body}\n-----END PUBLIC KEY-----\n")
    with pytest.raises(EvidenceError):
        read_public_key_file(pem)


@pytest.mark.parametrize("seed", [bytes(32), b"\xff" * 32, bytes(range(32))])
def test_a_published_key_neither_signs_nor_verifies(seed: bytes, tmp_path: Path) -> None:
    key = Ed25519PrivateKey.from_private_bytes(seed)
    private, public = tmp_path / "k.pem", tmp_path / "k.pub.pem"
    private.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    half = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    public.write_bytes(half)
    for read in (read_signing_key_or_none, read_public_key_file):
        path = private if read is read_signing_key_or_none else public
        with pytest.raises(EvidenceError, match="private half that is published"):
            read(path)


def test_a_key_as_it_should_be_has_no_weakness() -> None:
    for _ in range(20):
        raw = Ed25519PrivateKey.generate().public_key().public_bytes_raw()
        assert describe_key_weakness(raw) == ""


def test_evidence_that_names_a_weak_key_is_tampered(made: Made, tmp_path: Path) -> None:
    """The forger's trick: with the identity as key, R = identity and S = 0 sign anything."""
    weak = PublicKey((1).to_bytes(32, "little"))

    def forge(bundle: Bundle) -> None:
        bundle.evidence["signer"] |= {"key_id": weak.key_id, "public_key": weak.base64_text}

        def sign(folder: Path) -> None:
            held = json.loads((folder / "statement.dsse.json").read_bytes())
            signature = (1).to_bytes(32, "little") + bytes(32)
            held["signatures"] = [
                {"keyid": weak.key_id, "sig": base64.b64encode(signature).decode()}
            ]
            (folder / "statement.dsse.json").write_bytes(encode_canonical_json(held))

        bundle.last.append(sign)

    found = verify_bundle(tampered(made.bundle, tmp_path / "b", forge, signed=True))
    assert found.outcome is BundleOutcome.TAMPERED
    assert "small order" in items(found)
