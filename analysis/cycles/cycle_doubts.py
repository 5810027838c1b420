"""Doubts about counted loads whose fit is good."""

from collections.abc import Mapping
from typing import Any

import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.model.uncertainty_sources import STD_OF_MAD


def list_cycle_doubts(cycles: pl.DataFrame) -> list[str]:
    """Doubts about each cycle, joined by semicolons; empty without doubts or payload.

    Args:
        cycles: frame `cycles`, as counted.
    """
    counted = cycles.filter("counted")["payload_kg"]
    typical = spread = None
    if counted.len() >= LIMITS.unlike_load_min_loads:
        typical = counted.median()
        spread = (counted - typical).abs().median()
    return [_doubts_about_cycle(row, typical, spread) for row in cycles.iter_rows(named=True)]


def _doubts_about_cycle(row: Mapping[str, Any], typical_kg: Any, mad_kg: Any) -> str:
    """Doubts about one cycle, joined by semicolons."""
    payload_kg, u_kg = row["payload_kg"], row["payload_u_kg"]
    if payload_kg is None or not row["counted"]:
        return ""
    found: list[str] = []
    if payload_kg - LIMITS.coverage_factor * u_kg <= 0.0:
        found.append("the payload may be zero")
    back_kg, back_u_kg = row["carry_back_kg"], row["carry_back_u_kg"]
    if (
        back_kg is not None
        and back_u_kg is not None
        and abs(back_kg) > LIMITS.coverage_factor * back_u_kg
    ):
        if back_kg < 0.0:
            found.append(
                f"after the dump {-back_kg:,.0f} kg less than empty: the weighing is wrong"
            )
        elif back_kg > LIMITS.max_carried_fraction * abs(payload_kg):
            found.append(f"after the dump {back_kg:,.0f} kg still in the bucket")
    if typical_kg is not None:
        room_kg = LIMITS.unlike_load_std * float((STD_OF_MAD**2 * mad_kg**2 + u_kg**2) ** 0.5)
        if abs(payload_kg - typical_kg) > room_kg:
            found.append(f"unlike the other payloads, which are about {typical_kg:,.0f} kg")
    return "; ".join(found)
