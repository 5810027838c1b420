"""Who signed evidence, as far as a reader can know: never by the name that it gives itself."""

from dataclasses import dataclass
from shlex import quote
from typing import Literal


@dataclass(frozen=True, slots=True)
class SignedBy:
    """Whose signature it is.

    Attributes:
        how: "unsigned"; "unknown": by a key that nobody vouches for here; "given": by the key that
            the user gave; "known": by a key of the user's keyring; "broken": what is there is no
            signature of these files by that key.
        claimed: what the evidence calls its signer.
        owner: whose key it is by the keyring; "" where it is not in it.
        key_id: SHA-256 of the public key.
        public_key: the key, in base64.
    """

    how: Literal["unsigned", "unknown", "given", "known", "broken"]
    claimed: str = ""
    owner: str = ""
    key_id: str = ""
    public_key: str = ""

    @property
    def is_trusted(self) -> bool:
        """Whether the user vouches for the key."""
        return self.how in ("given", "known")

    @property
    def add_line(self) -> str:
        """The command that adds the key to the keyring."""
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
                owner = f", which the keyring has of {self.owner}," if self.owner else ""
                return f"signed by the key given, {short}{owner} {itself}"
            case "known":
                other = "" if self.claimed == self.owner else f" ({itself})"
                return f"signed by {self.owner}, key {short} of the keyring{other}"
