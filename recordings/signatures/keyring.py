"""Keyring of public keys whose owners the user knows, in one TOML file.

PAYSCOPE_KEYRING names the file; the default is `payscope/keys.toml` in the user's configuration
folder. The owner of a key is the one that the user enters; names in evidence are not trusted.
"""

import datetime as dt
import os
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    StringConstraints,
    ValidationError,
    model_validator,
)

from estimators.errors import EvidenceError
from recordings.signatures.signature_limits import LIMITS
from recordings.signatures.signing import (
    KEY_VARIABLE,
    PublicKey,
    SigningKey,
    read_signing_key_or_none,
)

#: Environment variable that names another keyring.
KEYRING_VARIABLE: Final = "PAYSCOPE_KEYRING"
_HEAD: Final = "# Keys that payscope knows, and their owners; changed by `payscope keys`.\n"

Owner = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\n\r]*$")]


class KnownKey(BaseModel):
    """Public key with its owner and the period in which its signatures count."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    owner: Owner
    valid_from: dt.date | None = None
    valid_to: dt.date | None = None
    revoked: dt.date | None = None
    because: Annotated[str, StringConstraints(max_length=200)] = ""

    @model_validator(mode="after")
    def _validate_key_and_dates(self) -> Self:
        try:
            self.public_key  # noqa: B018  reading it refuses a weak key
        except EvidenceError as fault:
            raise ValueError(str(fault)) from None
        if self.valid_from and self.valid_to and self.valid_to < self.valid_from:
            raise ValueError("valid_to is before valid_from; correct one of them")
        return self

    @property
    def public_key(self) -> PublicKey:
        """The public key."""
        return PublicKey.from_base64_text(self.key)

    def explain_distrust(self, signature_day: dt.date, proven_day: dt.date | None) -> str:
        """Say why a signature of a day does not count; "" if it does.

        Args:
            signature_day: date of signing according to the evidence.
            proven_day: date by which a time stamp proves that the signature existed, if any.
        """
        day = proven_day or signature_day
        if self.revoked is not None and (proven_day is None or proven_day >= self.revoked):
            why = f" ({self.because})" if self.because else ""
            return (
                f"was revoked on {self.revoked}{why}: whoever has had it since then can backdate "
                "a signature; only a time stamp from before that day would prove otherwise"
            )
        if self.valid_from is not None and day < self.valid_from:
            return f"is valid from {self.valid_from} only, but signed on {day}"
        if self.valid_to is not None and day > self.valid_to:
            return f"was valid to {self.valid_to} only, but signed on {day}"
        return ""


@dataclass(frozen=True, slots=True)
class Keyring:
    """Keys by their ids.

    Attributes:
        path: path of the file, which need not exist.
        keys: keys in the file's order.
    """

    path: Path
    keys: tuple[KnownKey, ...] = ()

    def find_key_by_id_or_prefix(self, key_id: str) -> KnownKey | None:
        """Find the key with this id, or the only one whose id begins with it; None otherwise."""
        found = [each for each in self.keys if each.public_key.key_id.startswith(key_id)]
        return found[0] if key_id and len(found) == 1 else None


def find_keyring_path() -> Path:
    """Find the path of the user's keyring."""
    named = os.environ.get(KEYRING_VARIABLE)
    if named:
        return Path(named)
    base = os.environ.get("XDG_CONFIG_HOME")
    try:
        return (Path(base) if base else Path.home() / ".config") / "payscope" / "keys.toml"
    except RuntimeError:  # a user without a home folder
        return Path("payscope-keys.toml")


def load_keyring(path: Path | None = None) -> Keyring:
    """Read a keyring; it is empty if the file does not exist.

    Args:
        path: path of the file; None for the user's.

    Raises:
        EvidenceError: the file cannot be read, is not a keyring, or has a weak or repeated key.
    """
    path = path or find_keyring_path()
    try:
        with path.open("rb") as file:
            data = file.read(LIMITS.keyring_bytes + 1)
    except FileNotFoundError:
        return Keyring(path)
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from None
    if len(data) > LIMITS.keyring_bytes:
        raise EvidenceError(
            f"{path}: is not a keyring: it has more than {LIMITS.keyring_bytes >> 20} MiB"
        )
    try:
        content: dict[str, Any] = tomllib.loads(data.decode())
    except ValueError as error:
        raise EvidenceError(f"{path}: is not valid TOML: {error}") from None
    rows = content.pop("keys", [])
    if content or not isinstance(rows, list):
        raise EvidenceError(f"{path}: is not a keyring: a keyring contains only [[keys]] tables")
    keys = tuple(
        validate_known_key(row, f"{path}: key {number}") for number, row in enumerate(rows, start=1)
    )
    ids = [each.public_key.key_id for each in keys]
    if len(set(ids)) < len(ids):
        raise EvidenceError(f"{path}: lists the same key twice; remove one entry")
    return Keyring(path, keys)


def read_valid_signing_key_or_none(path: Path | None) -> SigningKey | None:
    """Read a key as `read_signing_key_or_none` does, if the user's keyring does not forbid it.

    Raises:
        EvidenceError: as from that function; also if the keyring has the key as revoked, or not
            valid today.
    """
    key = read_signing_key_or_none(path)
    known = None if key is None else load_keyring().find_key_by_id_or_prefix(key.public_key.key_id)
    today = dt.datetime.now(dt.UTC).date()
    if known is not None and (fault := known.explain_distrust(today, None)):
        raise EvidenceError(
            f"{path or KEY_VARIABLE}: the key of {known.owner}, "
            f"{known.public_key.key_id[:12]}…, {fault}; sign with another key"
        )
    return key


def save_keyring(keyring_path: Path, keys: Sequence[KnownKey]) -> Keyring:
    """Write a keyring atomically, writable only by its owner.

    Raises:
        EvidenceError: the keyring cannot be written.
    """
    import tomlkit

    tables = tomlkit.aot()
    for each in keys:
        table = tomlkit.table()
        table.update(each.model_dump(exclude_defaults=True))
        tables.append(table)
    text = _HEAD + ("\n" + tomlkit.dumps({"keys": tables}) if keys else "")
    kept = keyring_path.resolve()  # the target of a link, which others may read too
    partial = kept.with_name(f".{kept.name}.{os.getpid()}")
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.touch(mode=0o600, exist_ok=False)
            partial.write_text(text, encoding="utf-8")
            partial.replace(kept)
        finally:
            with suppress(OSError):
                partial.unlink()
    except OSError as error:
        raise EvidenceError(f"{keyring_path}: cannot be written ({error.strerror})") from None
    return Keyring(keyring_path, tuple(keys))


def add_key_to_keyring(keyring: Keyring, known_key: KnownKey) -> Keyring:
    """Add a key, and write the keyring.

    Raises:
        EvidenceError: the keyring has the key already, or the file cannot be written.
    """
    same = keyring.find_key_by_id_or_prefix(known_key.public_key.key_id)
    if same is not None:
        raise EvidenceError(
            f"{keyring.path}: already contains key {known_key.public_key.key_id[:12]}…, of "
            f"{same.owner}"
        )
    return save_keyring(keyring.path, (*keyring.keys, known_key))


def revoke_key_in_keyring(keyring: Keyring, key_id: str, day: dt.date, reason: str) -> Keyring:
    """Mark a key as revoked, and write the keyring.

    Raises:
        EvidenceError: there is no such key, it was revoked on that day or before, the reason is too
            long, or the file cannot be written.
    """
    known = keyring.find_key_by_id_or_prefix(key_id)
    if known is None:
        ids = [each.public_key.key_id for each in keyring.keys]
        alike = [each for each in ids if key_id and each.startswith(key_id)]
        have = ", ".join(each[:12] for each in alike or ids) or "none"
        fault = f"several keys begin with '{key_id}'" if alike else f"no key '{key_id}'"
        remedy = f"give more digits of one of {have}" if alike else f"its keys: {have}"
        raise EvidenceError(f"{keyring.path}: {fault}; {remedy}")
    if known.revoked is not None and known.revoked <= day:
        raise EvidenceError(
            f"{keyring.path}: key {known.public_key.key_id[:12]}… of {known.owner} was revoked on "
            f"{known.revoked} already; only an earlier --day can replace that"
        )
    changed = {"revoked": day, "because": reason or known.because}
    revoked = validate_known_key({**known.model_dump(), **changed}, f"{keyring.path}: key {key_id}")
    return save_keyring(
        keyring.path, tuple(revoked if each is known else each for each in keyring.keys)
    )


def validate_known_key(row: object, name: str) -> KnownKey:
    """Validate an entry of a keyring.

    Args:
        row: fields of the key.
        name: name of file and key, for error messages.

    Raises:
        EvidenceError: a field is missing, invalid or too long.
    """
    try:
        return KnownKey.model_validate(row)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise EvidenceError(f"{name}: {place or 'it'}: {first['msg']}") from None
