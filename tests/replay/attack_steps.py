"""What an attacker does to evidence, and how `payscope` is then asked."""

import base64
import json
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from recordings.calibration.bundle_folder import READINGS, REPORT, STATEMENT, SUMS
from recordings.signatures.canonical_json import encode_canonical_json
from recordings.signatures.signing import (
    PAYLOAD_TYPE,
    PublicKey,
    SigningKey,
    encode_payload_for_signature,
    encode_signed_envelope,
    generate_key_pair_pem,
    read_signing_key_or_none,
)
from tests.replay.attacker import Bundle, Tamper, sign_with, sign_with_own_key, tampered
from tests.replay.made_evidence import Made
from tests.replay.sledge import MACHINE
from tests.replay.tamperings import fit

Asked = Sequence[object]


def verified(made: Made, folder: Path) -> Asked:
    return ("verify", folder, "--key", made.public, "--previous", made.first)


def changed(tamper: Tamper) -> Callable[[Made, Path], Asked]:
    """The second bundle, changed by one who lacks the key and keeps the old signature."""
    return lambda made, scratch: verified(
        made, tampered(made.bundle, scratch / "b", tamper, signed=True)
    )


def make_anew(*tampers: Tamper) -> Callable[[Made, Path], Asked]:
    """The same, signed by the attacker's own key."""
    return changed(together(*tampers, sign_with_own_key))


def resigned(*tampers: Tamper) -> Callable[[Made, Path], Asked]:
    """The same by whoever holds the signer's key: only what contradicts itself can be found."""
    return lambda made, scratch: verified(made, made_by_signer(made, scratch, *tampers))


def together(*tampers: Tamper) -> Tamper:
    def tamper(bundle: Bundle) -> None:
        for each in tampers:
            each(bundle)

    return tamper


def made_by_signer(made: Made, scratch: Path, *tampers: Tamper, of: Path | None = None) -> Path:
    key = read_signing_key_or_none(made.private)
    assert key is not None
    tamper = together(*tampers, lambda bundle: sign_with(bundle, key))
    return tampered(of or made.bundle, scratch / "resigned", tamper, signed=True)


def copied(change: Callable[[Path], object]) -> Callable[[Made, Path], Asked]:
    """A plain copy with one file changed, nothing computed anew."""

    def asked(made: Made, scratch: Path) -> Asked:
        folder = Path(shutil.copytree(made.bundle, scratch / "b"))
        change(folder)
        return verified(made, folder)

    return asked


def with_bytes(name: str, data: bytes) -> Callable[[Made, Path], Asked]:
    return copied(lambda folder: (folder / name).write_bytes(data))


def with_line(line: str) -> Callable[[Made, Path], Asked]:
    def change(folder: Path) -> None:
        (folder / SUMS).write_bytes((folder / SUMS).read_bytes() + line.encode())

    return copied(change)


def in_envelope(change: Callable[[dict[str, Any]], object]) -> Callable[[Made, Path], Asked]:
    """The statement's envelope changed, in canonical form."""

    def write(folder: Path) -> None:
        held = json.loads((folder / STATEMENT).read_bytes())
        change(held)
        (folder / STATEMENT).write_bytes(encode_canonical_json(held))

    return copied(write)


def in_statement(change: Callable[[dict[str, Any]], object]) -> Callable[[Made, Path], Asked]:
    """What is signed changed, under the old signature."""

    def inside(held: dict[str, Any]) -> None:
        said = json.loads(base64.b64decode(held["payload"]))
        change(said)
        held["payload"] = base64.b64encode(encode_canonical_json(said)).decode()

    return in_envelope(inside)


_L = 2**252 + 27742317777372353535851937790883648493


def twin_signature(held: dict[str, Any]) -> None:
    """S + L in the place of S: the same point, another signature."""
    raw = base64.b64decode(held["signatures"][0]["sig"])
    s = int.from_bytes(raw[32:], "little") + _L
    held["signatures"][0]["sig"] = base64.b64encode(raw[:32] + s.to_bytes(32, "little")).decode()


def weak_key_forgery(bundle: Bundle) -> None:
    """With the identity as key, R = identity and S = 0 sign anything."""
    weak = PublicKey((1).to_bytes(32, "little"))
    bundle.evidence["signer"] |= {"key_id": weak.key_id, "public_key": weak.base64_text}

    def sign(folder: Path) -> None:
        held = json.loads((folder / STATEMENT).read_bytes())
        forged = base64.b64encode((1).to_bytes(32, "little") + bytes(32)).decode()
        held["signatures"] = [{"keyid": weak.key_id, "sig": forged}]
        (folder / STATEMENT).write_bytes(encode_canonical_json(held))

    bundle.last.append(sign)


def signature(value: bytes) -> Callable[[Made, Path], Asked]:
    text = base64.b64encode(value).decode()
    return in_envelope(lambda held: held["signatures"][0].update(sig=text))


def of_first(name: str) -> Callable[[Made, Path], Asked]:
    """A file of the evidence before in the place of this one's."""

    def asked(made: Made, scratch: Path) -> Asked:
        folder = Path(shutil.copytree(made.bundle, scratch / "b"))
        shutil.copy(made.first / name, folder / name)
        return verified(made, folder)

    return asked


def unsigned(made: Made, scratch: Path) -> Asked:
    return verified(made, tampered(made.bundle, scratch / "b", lambda _: None, signed=False))


def with_other_key(made: Made, scratch: Path) -> Asked:
    _, public = generate_key_pair_pem()
    (scratch / "other.pem").write_bytes(public)
    return ("verify", made.bundle, "--key", scratch / "other.pem")


def signed_as_other_kind(made: Made, scratch: Path) -> Asked:
    """Right digests under the signer's key, of a statement that is none about evidence."""
    key = read_signing_key_or_none(made.private)
    assert key is not None
    folder = Path(shutil.copytree(made.bundle, scratch / "b"))
    held = json.loads((folder / STATEMENT).read_bytes())
    said = json.loads(base64.b64decode(held["payload"])) | {"predicateType": "https://slsa.dev/x"}
    (folder / STATEMENT).write_bytes(encode_signed_envelope(encode_canonical_json(said), key))
    return verified(made, folder)


def signed_under_other_type(made: Made, scratch: Path) -> Asked:
    key: SigningKey | None = read_signing_key_or_none(made.private)
    assert key is not None
    folder = Path(shutil.copytree(made.bundle, scratch / "b"))
    held = json.loads((folder / STATEMENT).read_bytes())
    other = key.sign_message(
        encode_payload_for_signature("text/plain", base64.b64decode(held["payload"]))
    )
    held["signatures"][0]["sig"] = base64.b64encode(other).decode()
    assert held["payloadType"] == PAYLOAD_TYPE
    (folder / STATEMENT).write_bytes(encode_canonical_json(held))
    return verified(made, folder)


# --- the chain


def chain(made: Made, *folders: Path) -> Asked:
    return ("verify", *folders, "--key", made.public)


def other_id(bundle: Bundle) -> None:
    bundle.evidence["id"] = "another"


def of_sister(bundle: Bundle) -> None:
    bundle.evidence["campaign"]["machine"]["id"] = "sledge-8"
    bundle.evidence["machine"]["machine"]["id"] = "sledge-8"


def forked(made: Made, scratch: Path) -> Asked:
    return chain(made, made.first, made.bundle, made_by_signer(made, scratch, other_id))


def on_a_fork(made: Made, scratch: Path) -> Asked:
    return chain(made, made.first, made_by_signer(made, scratch, other_id), made.third)


def sister_spliced(made: Made, scratch: Path) -> Asked:
    return verified(made, made_by_signer(made, scratch, of_sister))


def forged_before(made: Made, scratch: Path) -> Asked:
    forged = tampered(made.first, scratch / "b", sign_with_own_key, signed=True)
    return ("verify", made.bundle, "--key", made.public, "--previous", forged)


def forged_between(made: Made, scratch: Path) -> Asked:
    return chain(
        made, made.first, tampered(made.bundle, scratch / "b", sign_with_own_key, signed=True)
    )


def skipped(made: Made, _: Path) -> Asked:
    return ("verify", made.third, "--key", made.public, "--previous", made.first)


# --- days, machines, versions


def began(*texts: str) -> Tamper:
    def tamper(bundle: Bundle) -> None:
        for log, text in zip(bundle.evidence["logs"], texts, strict=False):
            log["begins"] = text

    return tamper


def at(name: str, value: Any) -> Tamper:
    return lambda bundle: bundle.evidence.update({name: value})


def logged_machine(bundle: Bundle) -> None:
    bundle.evidence["logs"][0]["machine_id"] = "sledge-8"


def later_version(*place: str) -> Tamper:
    def tamper(bundle: Bundle) -> None:
        inside = bundle.evidence
        for name in place[:-1]:
            inside = inside[name]
        inside[place[-1]] = 3
        bundle.evidence["software"]["payscope"] = "0.9.0"

    return tamper


# --- use


def used(made: Made, scratch: Path, folder: Path, *more: object, key: bool = True) -> Asked:
    """A later log is weighed with the evidence."""
    (scratch / "sledge.toml").write_text(MACHINE)
    log = made.campaign.parent / "load-1.csv"
    ask = ("--key", made.public) if key else ()
    at_file = ("-m", scratch / "sledge.toml", "--calibration", folder, "-o", scratch / "o.rrd")
    return ("run", log, *at_file, *ask, *more)


def used_forged(made: Made, scratch: Path) -> Asked:
    return used(made, scratch, tampered(made.bundle, scratch / "b", fit("alpha_1"), signed=True))


def used_anew(made: Made, scratch: Path) -> Asked:
    return used(made, scratch, tampered(made.bundle, scratch / "b", sign_with_own_key, signed=True))


def used_unknown(made: Made, scratch: Path) -> Asked:
    return used(made, scratch, made.bundle, "--require-signed", key=False)


def used_unsigned(made: Made, scratch: Path) -> Asked:
    folder = tampered(made.bundle, scratch / "b", lambda _: None, signed=False)
    return used(made, scratch, folder, "--require-signed", key=False)


def used_with_other_settings(made: Made, scratch: Path) -> Asked:
    return used(made, scratch, made.bundle, "--set", "settings.gate.window_samples=200")


def used_of_other_machine(made: Made, scratch: Path) -> Asked:
    return used(made, scratch, made.bundle, "--set", 'machine.id="sledge-8"')


def chained_to_forged(made: Made, scratch: Path) -> Asked:
    forged = tampered(made.first, scratch / "b", fit("alpha_1"), signed=True)
    new = ("-o", scratch / "new", "--key", made.private, "--previous", forged)
    return ("calibrate", made.campaign, *new)


def chained_to_unknown(made: Made, scratch: Path) -> Asked:
    forged = tampered(made.first, scratch / "b", sign_with_own_key, signed=True)
    new = ("-o", scratch / "new", "--key", made.private, "--previous", forged)
    return ("calibrate", made.campaign, *new)


def required_unknown(made: Made, _: Path) -> Asked:
    return ("verify", made.bundle, "--require-signed")


def linked(folder: Path) -> None:
    (folder / READINGS).rename(folder.parent / "kept.parquet")
    (folder / READINGS).symlink_to(folder.parent / "kept.parquet")


def piped(folder: Path) -> None:
    (folder / REPORT).unlink()
    os.mkfifo(folder / REPORT)


def swollen(folder: Path) -> None:
    with (folder / REPORT).open("wb") as file:
        file.truncate(40 << 20)


def signed_under_the_signers_id(bundle: Bundle) -> None:
    """The attacker's signature under the id of the signer's key."""

    def sign(folder: Path) -> None:
        held = json.loads((folder / STATEMENT).read_bytes())
        payload = base64.b64decode(held["payload"])
        made = json.loads(encode_signed_envelope(payload, SigningKey(Ed25519PrivateKey.generate())))
        held["signatures"][0]["sig"] = made["signatures"][0]["sig"]
        (folder / STATEMENT).write_bytes(encode_canonical_json(held))

    bundle.last.append(sign)
