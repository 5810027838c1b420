"""Signer of evidence, as far as it can be verified; names in the evidence are not trusted."""

from dataclasses import dataclass
from shlex import quote
from typing import Literal


@dataclass(frozen=True, slots=True)
class SignedBy:
    """Result of checking who signed evidence.

    Attributes:
        how: "unsigned"; "unknown": by a key that is not in the keyring; "given": by the key given
            by the user; "known": by a key in the keyring; "broken": the signature does not verify.
        claimed: name of the signer according to the evidence.
        owner: owner of the key according to the keyring; "" if the key is not in it.
        key_id: SHA-256 of the public key.
        public_key: public key in base64.
    """

    how: Literal["unsigned", "unknown", "given", "known", "broken"]
    claimed: str = ""
    owner: str = ""
    key_id: str = ""
    public_key: str = ""

    @property
    def is_trusted(self) -> bool:
        """Whether the user trusts the key."""
        return self.how in ("given", "known")

    @property
    def command_to_add_key(self) -> str:
        """Shell command with which the user adds the key to the keyring."""
        return f"payscope keys add {quote(self.public_key)} --owner OWNER"

    def __str__(self) -> str:
        short = f"{self.key_id[:12]}…"
        itself = f"that calls itself '{self.claimed}'" if self.claimed else "that gives no name"
        match self.how:
            case "unsigned":
                return "UNSIGNED"
            case "broken":
                return "signature not valid"
            case "unknown":
                return f"signed by an unknown key {short} {itself}"
            case "given":
                owner = f", which the keyring lists for {self.owner}," if self.owner else ""
                return f"signed by the key given, {short}{owner} {itself}"
            case "known":
                other = "" if self.claimed == self.owner else f" ({itself})"
                return f"signed by {self.owner}, key {short} of the keyring{other}"
