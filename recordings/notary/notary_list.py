"""List of a recorder's notary: one line per finished log, signed and chained to the previous line.

A line is canonical JSON (RFC 8785) with its own Ed25519 signature. The first line is the head: it
names the machine and the key. Every other line has a counter that grows by one, the digests of the
head and the previous line, and the log: its files with their SHA-256, its start and end, and the
time of listing.
"""

import base64
import binascii
import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import BaseModel, Field, StringConstraints, ValidationError

from analysis.model.strict_config import STRICT
from estimators.errors import EvidenceError
from recordings.notary.notary_limits import LIMITS
from recordings.signatures.canonical_json import encode_canonical_json, parse_canonical_json
from recordings.signatures.signing import PublicKey, SigningKey

FORMAT: Final = "payscope-notary/1"
#: Prefix of the signed bytes of a line, so that a signature is valid for no other purpose.
_DOMAIN: Final = b"payscope-notary/1\n"

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Stamp = Annotated[str, StringConstraints(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")]
Name = Annotated[str, StringConstraints(min_length=1, max_length=1000)]
Serial = Annotated[str, StringConstraints(pattern=r"^([A-Za-z0-9][A-Za-z0-9._-]{0,63})?$")]
Counter = Annotated[int, Field(ge=0, lt=2**53)]


class NotaryHead(BaseModel):
    """First line of a list."""

    model_config = STRICT

    format: Literal["payscope-notary/1"]
    counter: Literal[0]
    machine_id: Serial
    public_key: Annotated[str, StringConstraints(max_length=100)]
    #: Random, so that no two lists have the same head.
    nonce: Sha256
    begun: Stamp


class NotaryFile(BaseModel):
    """File of a log."""

    model_config = STRICT

    name: Name
    sha256: Sha256
    size_bytes: Counter
    modified_us: Counter


class NotaryEntry(BaseModel):
    """Entry of a finished log.

    Attributes:
        head: digest of the first line.
        previous: digest of the previous line.
        log: name of the log, relative to the watched folder.
        files: files of the log.
        begins: time of its first message; "" if its format or clock gives none.
        ends: time of its last message.
        listed: time of listing, by the computer's clock.
        machine_id: machine named in its metadata; "" if they name none.
        replaces: counter of an earlier entry of the same name with other files; None if the name is
            new.
    """

    model_config = STRICT

    counter: Annotated[int, Field(ge=1, lt=2**53)]
    head: Sha256
    previous: Sha256
    log: Name
    files: tuple[NotaryFile, ...] = Field(min_length=1)
    begins: Stamp | Literal[""]
    ends: Stamp | Literal[""]
    listed: Stamp
    machine_id: Annotated[str, StringConstraints(max_length=64)]
    replaces: Annotated[int, Field(ge=1, lt=2**53)] | None


@dataclass(frozen=True, slots=True)
class NotaryLine:
    """Line read from a list.

    Attributes:
        data: bytes of the line without the newline.
        content: head or entry.
        signature: Ed25519 signature, 64 bytes.
    """

    data: bytes
    content: NotaryHead | NotaryEntry
    signature: bytes

    @property
    def line_sha256(self) -> str:
        """SHA-256 in hex by which the next line refers to this one."""
        return hashlib.sha256(self.data).hexdigest()

    def is_signed_by(self, public_key: PublicKey) -> bool:
        """Whether this key signed the line."""
        return public_key.does_verify_signature(
            self.signature, encode_line_content_to_sign(self.content)
        )


def encode_line_content_to_sign(line_content: NotaryHead | NotaryEntry) -> bytes:
    """Encode the bytes of a line that are signed: canonical JSON after the prefix."""
    return _DOMAIN + encode_canonical_json(line_content.model_dump(mode="json"))


def make_signed_line(line_content: NotaryHead | NotaryEntry, signing_key: SigningKey) -> NotaryLine:
    """Sign the content of a line, and make the line."""
    signature = signing_key.sign_message(encode_line_content_to_sign(line_content))
    text = base64.b64encode(signature).decode()
    data = encode_canonical_json({**line_content.model_dump(mode="json"), "signature": text})
    return NotaryLine(data, line_content, signature)


def parse_untrusted_line(line_bytes: bytes, source: str) -> NotaryLine:
    """Parse an untrusted line, whose content is to be trusted only if `is_signed_by` is True.

    Args:
        line_bytes: bytes without the newline.
        source: name of the line, for error messages.

    Raises:
        EvidenceError: the bytes are not a line as made by `make_signed_line`.
    """
    if len(line_bytes) > LIMITS.line_bytes:
        raise EvidenceError(
            f"{source}: has more than {LIMITS.line_bytes >> 20} MiB, the most that a line may have"
        )
    values: Any = parse_canonical_json(line_bytes, source)
    if not isinstance(values, dict) or not isinstance(values.get("signature"), str):
        raise EvidenceError(f"{source}: has no signature, so it is no line of a notary list")
    text = values.pop("signature")
    model = NotaryHead if values.get("counter") == 0 else NotaryEntry
    try:
        signature = base64.b64decode(text, validate=True)
        content = model.model_validate_json(encode_canonical_json(values))
    except (binascii.Error, ValueError) as fault:
        raise EvidenceError(f"{source}: {_format_validation_fault(fault)}") from None
    if encode_canonical_json({**content.model_dump(mode="json"), "signature": text}) != line_bytes:
        raise EvidenceError(
            f"{source}: a value has another type than `payscope notarise` writes, so the line was "
            "changed"
        )
    if len(signature) != 64 or base64.b64encode(signature).decode() != text:
        raise EvidenceError(
            f"{source}: its signature is not the base64 text of 64 bytes, so the line was "
            "changed or damaged after it was signed"
        )
    return NotaryLine(line_bytes, content, signature)


def _format_validation_fault(fault: Exception) -> str:
    if isinstance(fault, ValidationError):
        first = fault.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return "its signature is not base64 text, so the line was changed or damaged"


class SplitNotaryList(NamedTuple):
    """Complete lines of a list, and the incomplete rest after the last newline."""

    whole_lines: list[bytes]
    truncated_tail: bytes


def split_list_into_complete_lines_and_tail(list_bytes: bytes) -> SplitNotaryList:
    """Split a list into complete lines, and the incomplete rest after the last newline."""
    *whole, tail = list_bytes.split(b"\n")
    return SplitNotaryList(whole, tail)


def encode_notary_lines(lines: Iterable[NotaryLine]) -> bytes:
    """Encode lines as the bytes of a file."""
    return b"".join(line.data + b"\n" for line in lines)
