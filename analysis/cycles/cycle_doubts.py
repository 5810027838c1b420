"""What makes a counted load worth a second look, though the fit calls it good."""

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

#: Coverage factor of a 95 % interval.
_K: Final = 2.0
#: A bucket seldom brings back more than this share of its load: then it was not emptied, or the
#: empty drive was weighed wrong.
_CARRIED_SHARE: Final = 0.25
#: A load this many robust standard deviations from the median of the shift is unlike the others.
_UNLIKE: Final = 4.0
#: Standard deviation of a normal distribution over its median absolute deviation.
_STD_OF_MAD: Final = 1.4826
#: Fewer loads have no usual size.
_FEWEST: Final = 8


def cycle_doubts(cycles: pl.DataFrame) -> list[str]:
    """Doubts of each cycle, joined by semicolons; empty where there is none or no payload.

    Args:
        cycles: frame `cycles`, as counted.
    """
    counted = cycles.filter("counted")["payload_kg"]
    typical = spread = None
    if counted.len() >= _FEWEST:
        typical = counted.median()
        spread = (counted - typical).abs().median()
    return [_row_doubts(row, typical, spread) for row in cycles.iter_rows(named=True)]


def _row_doubts(row: Mapping[str, Any], typical_kg: Any, mad_kg: Any) -> str:
    payload_kg, u_kg = row["payload_kg"], row["payload_u_kg"]
    if payload_kg is None or not row["counted"]:
        return ""
    found: list[str] = []
    if payload_kg - _K * u_kg <= 0.0:
        found.append("the payload may be nothing")
    back_kg, back_u_kg = row["carry_back_kg"], row["carry_back_u_kg"]
    if back_kg is not None and back_u_kg is not None and abs(back_kg) > _K * back_u_kg:
        if back_kg < 0.0:
            found.append(f"after the dump {-back_kg:,.0f} kg less than empty: weighed wrong")
        elif back_kg > _CARRIED_SHARE * abs(payload_kg):
            found.append(f"after the dump {back_kg:,.0f} kg still in the bucket")
    if typical_kg is not None:
        room_kg = _UNLIKE * float((_STD_OF_MAD**2 * mad_kg**2 + u_kg**2) ** 0.5)
        if abs(payload_kg - typical_kg) > room_kg:
            found.append(f"unlike the others, which are about {typical_kg:,.0f} kg")
    return "; ".join(found)
