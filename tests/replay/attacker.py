"""Somebody who can write every file of a bundle and compute every digest, and lacks the key."""

import base64
import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import (
    EVIDENCE,
    POINTS,
    READINGS,
    REPORT,
    STATEMENT,
    SUMS,
    format_sha256sums,
    list_bundle_files_and_faults,
    read_bundle_file,
)
from recordings.calibration.calibration_report import render_report_html
from recordings.calibration.evidence_document import EvidenceDocument, parse_untrusted_evidence
from recordings.calibration.untrusted_files import encode_uncompressed_parquet_table
from recordings.signatures.canonical_json import encode_canonical_json
from recordings.signatures.signing import (
    PAYLOAD_TYPE,
    SigningKey,
    encode_in_toto_statement,
    encode_signed_envelope,
    generate_key_pair_pem,
)


def key_files(folder: Path, name: str = "key") -> tuple[Path, Path]:
    """A new key: its private and its public file."""
    private, public = folder / f"{name}.pem", folder / f"{name}.pub.pem"
    for path, half in zip((private, public), generate_key_pair_pem(), strict=True):
        path.write_bytes(half)
    return private, public


@dataclass
class Bundle:
    """A bundle taken apart."""

    folder: Path
    evidence: dict[str, Any]
    readings: pl.DataFrame
    points: pl.DataFrame
    #: made after everything else is written, on the bytes of that file
    bytes_of: dict[str, Callable[[bytes], bytes]] = field(default_factory=dict)
    #: done last, when digests are computed already
    last: list[Callable[[Path], None]] = field(default_factory=list)

    def run(self, number: int) -> dict[str, Any]:
        return self.evidence["campaign"]["runs"][number]

    def reading(self, number: int, **values: Any) -> None:
        rows = self.readings.to_dicts()
        rows[number] |= values
        self.readings = pl.DataFrame(rows, schema=self.readings.schema)


Tamper = Callable[[Bundle], object]


def tampered(genuine: Path, folder: Path, tamper: Tamper, *, signed: bool) -> Path:
    """Copy a bundle, change it, and compute everything anew that needs no key.

    Args:
        genuine: a signed bundle.
        folder: where the copy goes.
        tamper: the one change.
        signed: whether a statement is kept, with the old signature; else signer and statement go.
    """
    shutil.copytree(genuine, folder)
    bundle = Bundle(
        folder,
        json.loads((folder / EVIDENCE).read_bytes()),
        pl.read_parquet(folder / READINGS),
        pl.read_parquet(folder / POINTS),
    )
    if not signed:
        bundle.evidence["signer"] = None
        (folder / STATEMENT).unlink()
    tamper(bundle)
    _write(bundle)
    for name, change in bundle.bytes_of.items():
        (folder / name).write_bytes(change((folder / name).read_bytes()))
    _digest_anew(bundle)
    for step in bundle.last:
        step(folder)
    return folder


def _write(bundle: Bundle) -> None:
    folder = bundle.folder
    for name, frame in ((READINGS, bundle.readings), (POINTS, bundle.points)):
        data = encode_uncompressed_parquet_table(frame)
        (folder / name).write_bytes(data)
        bundle.evidence["tables"][f"{name.partition('.')[0]}_sha256"] = hashlib.sha256(
            data
        ).hexdigest()
    data = encode_canonical_json(bundle.evidence)
    (folder / EVIDENCE).write_bytes(data)
    try:
        document: EvidenceDocument = parse_untrusted_evidence(data, EVIDENCE)
    except EvidenceError:
        return  # the schema will refuse it; the page stays as it was
    (folder / REPORT).write_bytes(
        render_report_html(document, bundle.readings, bundle.points).encode()
    )


def _digest_anew(bundle: Bundle) -> None:
    folder = bundle.folder
    names, _ = list_bundle_files_and_faults(folder)
    digests = {n: read_bundle_file(folder, n).sha256 for n in names if n not in (SUMS, STATEMENT)}
    sums = format_sha256sums(digests).encode()
    (folder / SUMS).write_bytes(sums)
    if (folder / STATEMENT).exists():
        held = json.loads((folder / STATEMENT).read_bytes())
        said = json.loads(base64.b64decode(held["payload"]))
        digests[SUMS] = hashlib.sha256(sums).hexdigest()
        said["subject"] = [{"name": n, "digest": {"sha256": digests[n]}} for n in sorted(digests)]
        evidence = bundle.evidence
        said["predicate"] |= {
            "id": evidence["id"],
            "kind": evidence["kind"],
            "machine": evidence["campaign"]["machine"]["id"],
            "made": evidence["made"],
            "counter": evidence["chain"]["counter"],
            "previous": evidence["chain"]["previous"],
        }
        held["payload"] = base64.b64encode(encode_canonical_json(said)).decode()
        (folder / STATEMENT).write_bytes(encode_canonical_json(held))


def sign_with_own_key(bundle: Bundle) -> None:
    """Put the attacker's key in the place of the signer's, and sign."""
    sign_with(bundle, SigningKey(Ed25519PrivateKey.generate()))


def sign_with(bundle: Bundle, key: SigningKey) -> None:
    """Sign, by whoever holds the key: it may be the signer's own."""
    bundle.evidence["signer"] |= {
        "key_id": key.public_key.key_id,
        "public_key": key.public_key.base64_text,
    }

    def sign(folder: Path) -> None:
        held = json.loads((folder / STATEMENT).read_bytes())
        assert held["payloadType"] == PAYLOAD_TYPE
        said = json.loads(base64.b64decode(held["payload"]))
        digests = {each["name"]: each["digest"]["sha256"] for each in said["subject"]}
        (folder / STATEMENT).write_bytes(
            encode_signed_envelope(encode_in_toto_statement(digests, said["predicate"]), key)
        )

    bundle.last.append(sign)
