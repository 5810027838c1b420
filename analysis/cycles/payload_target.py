"""Payloads against the target of a truck or a bucket: the 10/10/20 rule."""

from typing import NamedTuple

import polars as pl

from analysis.cycles.cycle_limits import LIMITS


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
    above = int((payload > LIMITS.above_target_ratio * target_kg).sum())
    never = int((payload > LIMITS.never_above_ratio * target_kg).sum())
    close = (
        (payload - border * target_kg).abs() < LIMITS.sure_border_std * u_kg
        for border in (LIMITS.above_target_ratio, LIMITS.never_above_ratio)
    )
    first, second = close
    mean_kg = float(payload.mean())  # pyright: ignore[reportArgumentType]
    return TargetCheck(
        target_kg,
        counted.height,
        mean_kg,
        above,
        never,
        int((first | second).sum()),
        above <= LIMITS.above_target_fraction * counted.height
        and not never
        and mean_kg <= target_kg,
    )
