"""Ed25519 public keys that no signature may rely on: anyone can sign for them.

A key of small order accepts signatures that nobody made; the private half of a published key is
known to all.
Source: RFC 8032, 5.1.3 (decoding) and 7.1 (test vectors); order-8 points as in libsodium's list.
"""

from functools import cache
from typing import Final

#: The prime of Curve25519.
_P: Final = 2**255 - 19
_D: Final = -121665 * pow(121666, -1, _P) % _P
#: y of a point of order 8; that of its negative is P less this.
_ORDER_8: Final = int.from_bytes(
    bytes.fromhex("26e8958fc2b227b045c3f489f2ef98f0d5dfac05d3c63339b13802886d53fc05"), "little"
)
#: y of every point of small order: of order 4, 1, 2 and 8.
_SMALL_ORDER: Final = frozenset({0, 1, _P - 1, _ORDER_8, _P - _ORDER_8})
#: Private keys printed in RFC 8032, and those that a careless program makes: one byte repeated.
_PUBLISHED_SEEDS: Final = (
    "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
    "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
    "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
    "f5e5767cf153319517630f226876b86c8160cc583bc013744c6bf255f5cc0ee5",
    "833fe62409237b9d62ec77587520911e9a759cec1d19755b7da901b96dca3d42",
    bytes(range(32)).hex(),
    bytes(range(1, 33)).hex(),
)


def weakness(raw: bytes) -> str:
    """Why no signature by this key may be relied on; "" if nothing is known against it.

    Args:
        raw: the 32 bytes of a public key.
    """
    y = int.from_bytes(raw, "little") & ((1 << 255) - 1)
    if y >= _P:
        return "is not in its one canonical form"
    if y in _SMALL_ORDER:
        return "is of small order: anyone can sign for it"
    if not _on_curve(y):
        return "is no point of the curve"
    if raw in _published():
        return "has a private half that is published: anyone can sign for it"
    return ""


def _on_curve(y: int) -> bool:
    """Whether x² = (y² - 1) / (d y² + 1) has a solution (Euler's criterion)."""
    square = (y * y - 1) * pow(_D * y * y + 1, -1, _P) % _P
    return square == 0 or pow(square, (_P - 1) // 2, _P) == 1


@cache
def _published() -> frozenset[bytes]:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    seeds = [bytes.fromhex(seed) for seed in _PUBLISHED_SEEDS]
    seeds += [bytes([value]) * 32 for value in range(256)]
    return frozenset(
        Ed25519PrivateKey.from_private_bytes(seed).public_key().public_bytes_raw() for seed in seeds
    )
