"""Payloads against the target of a truck or a bucket: the 10/10/20 rule."""

from typing import Final, NamedTuple

import polars as pl

#: At most this share of loads above 110 % of the target, the mean at most the target, none above
#: 120 % (Caterpillar, Mining Truck Payload Policy 10/10/20).
_MOST: Final = 0.10
_ABOVE: Final = 1.1
_NEVER: Final = 1.2
#: So many of its deviations a load lies beyond a border for sure.
_SURE: Final = 2.0


class TargetCheck(NamedTuple):
    """The 10/10/20 rule.

    Attributes:
        target_kg: of a load.
        loads: that were judged.
        mean_kg: of them.
        above: above 110 %.
        never: above 120 %.
        near: whose uncertainty reaches over either border.
        keeps: whether the rule is kept.
    """

    target_kg: float
    loads: int
    mean_kg: float
    above: int
    never: int
    near: int
    keeps: bool


def check_target(counted: pl.DataFrame, target_kg: float) -> TargetCheck | None:
    """Judge the counted payloads; None where there are none.

    Args:
        counted: rows of `cycles` with a payload.
        target_kg: of a load.
    """
    if counted.is_empty():
        return None
    payload, u_kg = counted["payload_kg"], counted["payload_u_kg"]
    above = int((payload > _ABOVE * target_kg).sum())
    never = int((payload > _NEVER * target_kg).sum())
    close = ((payload - border * target_kg).abs() < _SURE * u_kg for border in (_ABOVE, _NEVER))
    first, second = close
    mean_kg = float(payload.mean())  # pyright: ignore[reportArgumentType]
    return TargetCheck(
        target_kg,
        counted.height,
        mean_kg,
        above,
        never,
        int((first | second).sum()),
        above <= _MOST * counted.height and not never and mean_kg <= target_kg,
    )
