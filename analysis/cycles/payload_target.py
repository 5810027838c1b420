"""Comparison of payloads with a target by the 10/10/20 rule."""

from typing import NamedTuple

import polars as pl

from analysis.cycles.cycle_limits import LIMITS


class TargetCheck(NamedTuple):
    """Result of the 10/10/20 rule.

    Attributes:
        target_kg: target of a load.
        loads: number of judged loads.
        mean_kg: mean load.
        above: number of loads above 110 %.
        never: number of loads above 120 %, which the rule forbids.
        near: number of loads whose distance to either limit is within their uncertainty.
        keeps: whether the loads comply with the rule.
    """

    target_kg: float
    loads: int
    mean_kg: float
    above: int
    never: int
    near: int
    keeps: bool


def compare_payloads_with_target(
    counted_cycles: pl.DataFrame, target_kg: float
) -> TargetCheck | None:
    """Compare the counted payloads with the target; None without any.

    Args:
        counted_cycles: rows of `cycles` with a payload.
        target_kg: target of a load.
    """
    if counted_cycles.is_empty():
        return None
    payload, u_kg = counted_cycles["payload_kg"], counted_cycles["payload_u_kg"]
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
        counted_cycles.height,
        mean_kg,
        above,
        never,
        int((first | second).sum()),
        above <= LIMITS.above_target_fraction * counted_cycles.height
        and not never
        and mean_kg <= target_kg,
    )
