"""Sign the files of a bundle by Ed25519: an in-toto statement about them in a DSSE envelope.

Signatures by a weak key do not count: a key of small order accepts forged signatures, and the
private half of a published key is known to everyone.
Source: DSSE v1.0 (secure-systems-lab/dsse, protocol.md), in-toto Attestation Framework v1
(spec/v1/statement.md and envelope.md), RFC 8032 for Ed25519 (5.1.3 for weak keys, 7.1 for published
ones; order-8 points as in the list of libsodium), RFC 5958 and 8410 for its keys.
"""

import base64
import binascii
import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from estimators.errors import EvidenceError
from recordings.signatures.canonical_json import encode_canonical_json, parse_canonical_json
from recordings.signatures.signature_limits import LIMITS

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (
        Ed25519PrivateKey,
        Ed25519PublicKey,
    )

PAYLOAD_TYPE: Final = "application/vnd.in-toto+json"
STATEMENT_TYPE: Final = "https://in-toto.io/Statement/v1"
#: A mere name and not an address: the top-level domain is reserved (RFC 2606).
PREDICATE_TYPE: Final = "https://payscope.invalid/calibration-evidence/v1"
#: Environment variable that may contain the private key, in PEM.
KEY_VARIABLE: Final = "PAYSCOPE_SIGNING_KEY"
_MAKE: Final = "openssl genpkey -algorithm ed25519 -out key.pem"
_PUBLISH: Final = "openssl pkey -in key.pem -pubout -out key.pub.pem"
#: The prime of Curve25519.
_P: Final = 2**255 - 19
_D: Final = -121665 * pow(121666, -1, _P) % _P
#: y of a point of order 8; the other y of order 8 is P minus this.
_ORDER_8: Final = int.from_bytes(
    bytes.fromhex("26e8958fc2b227b045c3f489f2ef98f0d5dfac05d3c63339b13802886d53fc05"), "little"
)
#: y of every point of small order: of order 4, 1, 2 and 8.
_SMALL_ORDER: Final = frozenset({0, 1, _P - 1, _ORDER_8, _P - _ORDER_8})
#: Private keys printed in RFC 8032, and keys of one repeated byte, as careless programs make them.
_PUBLISHED_SEEDS: Final = (
    "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
    "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
    "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
    "f5e5767cf153319517630f226876b86c8160cc583bc013744c6bf255f5cc0ee5",
    "833fe62409237b9d62ec77587520911e9a759cec1d19755b7da901b96dca3d42",
    bytes(range(32)).hex(),
    bytes(range(1, 33)).hex(),
)


@dataclass(frozen=True, slots=True)
class PublicKey:
    """Ed25519 public key.

    Attributes:
        raw: the key's 32 bytes.
    """

    raw: bytes

    @property
    def key_id(self) -> str:
        """SHA-256 of the raw key, in hex."""
        return hashlib.sha256(self.raw).hexdigest()

    @property
    def base64_text(self) -> str:
        """The raw key in base64."""
        return base64.b64encode(self.raw).decode()

    @classmethod
    def from_base64_text(cls, text: str) -> "PublicKey":
        """Parse a key in base64, as `base64_text` returns it.

        Raises:
            EvidenceError: the text is not base64 of 32 bytes, or the key is weak.
        """
        raw = _decode_base64_or_refuse(text, "a public key")
        if len(raw) != 32:
            raise EvidenceError(
                f"an Ed25519 public key has 32 bytes, this one {len(raw)}; copy the key again"
            )
        return cls(raw).refuse_weak_key()

    def refuse_weak_key(self) -> "PublicKey":
        """Return the key if its signatures can be relied on.

        Raises:
            EvidenceError: the key is weak (`describe_key_weakness`).
        """
        fault = describe_key_weakness(self.raw)
        if fault:
            raise EvidenceError(f"weak key {self.key_id[:12]}…: it {fault}; `{_MAKE}` makes one")
        return self

    def does_verify_signature(self, signature: bytes, message: bytes) -> bool:
        """Whether this key made this signature of this message."""
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

        try:
            Ed25519PublicKey.from_public_bytes(self.raw).verify(signature, message)
        except (InvalidSignature, ValueError):
            return False
        return True


@dataclass(frozen=True, slots=True)
class SigningKey:
    """Private key, which `repr` does not show."""

    private: "Ed25519PrivateKey"

    @property
    def public_key(self) -> PublicKey:
        """Public key that verifies its signatures."""
        return _convert_library_key(self.private.public_key())

    def refuse_published_key(self, source: str) -> "SigningKey":
        """Return the key unless it is a published one.

        Raises:
            EvidenceError: the private key is published.
        """
        _refuse_weak_key_of_source(self.public_key, source)
        return self

    def sign_message(self, message: bytes) -> bytes:
        """Sign a message; the signature has 64 bytes."""
        return self.private.sign(message)


class KeyPairPem(NamedTuple):
    """Both halves of a key in PEM."""

    private_pem: bytes
    public_pem: bytes


def generate_key_pair_pem() -> KeyPairPem:
    """Generate a key: private and public half in PEM."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
        PublicFormat,
    )

    key = Ed25519PrivateKey.generate()
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    return KeyPairPem(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), public)


def read_signing_key_or_none(path: Path | None) -> SigningKey | None:
    """Read a private key from a file, or else from the environment variable; None without either.

    Raises:
        EvidenceError: the key cannot be read, or is not a private Ed25519 key in PEM without a
            password.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    if path is None and not os.environ.get(KEY_VARIABLE):
        return None
    where = str(path) if path is not None else f"environment variable {KEY_VARIABLE}"
    data = _read_key_file(path) if path is not None else os.environ[KEY_VARIABLE].encode()
    try:
        key = load_pem_private_key(data, password=None)
    except TypeError:
        raise EvidenceError(f"{where}: is encrypted; give a key without a password") from None
    except (ValueError, UnsupportedAlgorithm):
        raise EvidenceError(f"{where}: holds no private key in PEM; `{_MAKE}` makes one") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise EvidenceError(f"{where}: is not an Ed25519 key; `{_MAKE}` makes one")
    return SigningKey(key).refuse_published_key(where)


def read_public_key_file(path: Path) -> PublicKey:
    """Read a public key from a file.

    Raises:
        EvidenceError: the key cannot be read, is not a public Ed25519 key in PEM, or is weak.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    data = _read_key_file(path)
    if b"PRIVATE KEY" in data:
        raise EvidenceError(f"{path}: is a private key; `{_PUBLISH}` writes the public one")
    try:
        key = load_pem_public_key(data)
    except (ValueError, UnsupportedAlgorithm):
        raise EvidenceError(f"{path}: holds no public key in PEM; `{_PUBLISH}` writes it") from None
    if not isinstance(key, Ed25519PublicKey):
        raise EvidenceError(f"{path}: is not an Ed25519 key; give the one that signed the evidence")
    return _refuse_weak_key_of_source(_convert_library_key(key), str(path))


def encode_payload_for_signature(payload_type: str, payload: bytes) -> bytes:
    """Encode the bytes to be signed by DSSE's pre-authentication encoding (protocol.md)."""
    kind = payload_type.encode()
    return b"DSSEv1 %d %b %d %b" % (len(kind), kind, len(payload), payload)


def encode_in_toto_statement(digests: Mapping[str, str], predicate: Mapping[str, Any]) -> bytes:
    """Encode an in-toto statement about files: their SHA-256 by name, and a predicate."""
    return encode_canonical_json(
        {
            "_type": STATEMENT_TYPE,
            "subject": [
                {"name": name, "digest": {"sha256": digests[name]}} for name in sorted(digests)
            ],
            "predicateType": PREDICATE_TYPE,
            "predicate": dict(predicate),
        }
    )


def encode_signed_envelope(payload: bytes, signing_key: SigningKey) -> bytes:
    """Sign a statement, and encode it in a DSSE envelope."""
    signature = signing_key.sign_message(encode_payload_for_signature(PAYLOAD_TYPE, payload))
    return encode_canonical_json(
        {
            "payloadType": PAYLOAD_TYPE,
            "payload": base64.b64encode(payload).decode(),
            "signatures": [
                {
                    "keyid": signing_key.public_key.key_id,
                    "sig": base64.b64encode(signature).decode(),
                }
            ],
        }
    )


@dataclass(frozen=True, slots=True)
class EnvelopeContent:
    """Content of a DSSE envelope.

    Attributes:
        payload: bytes of the statement.
        statement: parsed statement.
        signature: Ed25519 signature, 64 bytes.
        key_id: key id in the envelope, a hint on which no check relies.
    """

    payload: bytes
    statement: Mapping[str, Any]
    signature: bytes
    key_id: str

    def is_signed_by(self, public_key: PublicKey) -> bool:
        """Whether this key signed the statement."""
        return public_key.does_verify_signature(
            self.signature, encode_payload_for_signature(PAYLOAD_TYPE, self.payload)
        )


def parse_untrusted_envelope(envelope_bytes: bytes, source: str) -> EnvelopeContent:
    """Parse an untrusted envelope, whose content is to be trusted only if `is_signed_by` is True.

    Raises:
        EvidenceError: the bytes are not an envelope as `encode_signed_envelope` writes it.
    """
    held = parse_canonical_json(envelope_bytes, source)
    try:
        (signature,) = held["signatures"]
        fits = set(held) == {"payloadType", "payload", "signatures"}
        fits = fits and set(signature) == {"keyid", "sig"} and held["payloadType"] == PAYLOAD_TYPE
        payload = _decode_base64_or_refuse(held["payload"], f"{source}: its payload")
        signed = _decode_base64_or_refuse(signature["sig"], f"{source}: its signature")
        key_id = signature["keyid"]
    except (TypeError, KeyError, ValueError, AttributeError):
        raise EvidenceError(
            f"{source}: is not a signed statement (DSSE envelope with one signature); copy the "
            "bundle again"
        ) from None
    inside = parse_canonical_json(payload, f"{source}: its statement")
    if not fits or not isinstance(inside, dict) or not isinstance(key_id, str):
        raise EvidenceError(
            f"{source}: is not an in-toto statement in a DSSE envelope; copy the bundle again"
        )
    return EnvelopeContent(payload, inside, signed, key_id)


def _decode_base64_or_refuse(text: str, source: str) -> bytes:
    try:
        data = base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError, TypeError):
        raise EvidenceError(
            f"{source} is not base64; copy it again from the original file"
        ) from None
    # several texts decode to the same bytes, of which only one is accepted
    if base64.b64encode(data).decode() != text:
        raise EvidenceError(
            f"{source} is not canonical base64; copy it again from the original file"
        )
    return data


def _read_key_file(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LIMITS.key_bytes + 1)
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from None
    if len(data) > LIMITS.key_bytes:
        raise EvidenceError(
            f"{path}: is not a key file: it has more than {LIMITS.key_bytes >> 10} KiB"
        )
    return data


def _refuse_weak_key_of_source(public_key: PublicKey, source: str) -> PublicKey:
    try:
        return public_key.refuse_weak_key()
    except EvidenceError as fault:
        raise EvidenceError(f"{source}: {fault}") from None


def _convert_library_key(library_key: "Ed25519PublicKey") -> PublicKey:
    return PublicKey(library_key.public_bytes_raw())


def describe_key_weakness(raw_key: bytes) -> str:
    """Say why signatures by a key cannot be relied on; "" if no weakness is known.

    Args:
        raw_key: 32 bytes of a public key.
    """
    y = int.from_bytes(raw_key, "little") & ((1 << 255) - 1)
    if y >= _P:
        return "is not in canonical form"
    if y in _SMALL_ORDER:
        return "has small order: anyone can forge its signatures"
    if not _is_y_on_curve(y):
        return "is not a point of the curve"
    if raw_key in _load_published_keys():
        return "has a private half that is published: anyone can sign for it"
    return ""


def _is_y_on_curve(y_coordinate: int) -> bool:
    """Whether x² = (y² - 1) / (d y² + 1) has a solution (Euler's criterion)."""
    square = (
        (y_coordinate * y_coordinate - 1) * pow(_D * y_coordinate * y_coordinate + 1, -1, _P) % _P
    )
    return square == 0 or pow(square, (_P - 1) // 2, _P) == 1


@cache
def _load_published_keys() -> frozenset[bytes]:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    seeds = [bytes.fromhex(seed) for seed in _PUBLISHED_SEEDS]
    seeds += [bytes([value]) * 32 for value in range(256)]
    return frozenset(
        Ed25519PrivateKey.from_private_bytes(seed).public_key().public_bytes_raw() for seed in seeds
    )
