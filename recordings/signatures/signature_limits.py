"""Bounds of signed documents, keys and keyrings that are read."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class SignatureLimits:
    """Bounds of signed documents, keys and keyrings that are read.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # canonical_json
    #: Most bytes of a document; that of a thousand runs has about one million.
    document_bytes: int = 16 << 20
    #: Greatest depth of nested objects and lists.
    document_depth: int = 32
    #: Most characters of a number: 17 digits, sign, point and exponent, and some more.
    number_characters: int = 32

    # keyring
    #: Most bytes of a keyring; a key takes some two hundred.
    keyring_bytes: int = 1 << 20

    # signing
    #: Most bytes of a key file, which has some hundred.
    key_bytes: int = 16 << 10


#: The values in use.
LIMITS: Final = SignatureLimits()
