"""A shift of the sledge: pushed empty, loaded, pushed with the load, emptied, again and again."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from tests.replay.sledge import sledge

EMPTY_KG = 100.0
#: Of each load, in kg.
PAYLOADS_KG = (40.0, 30.0, 50.0, 35.0, 45.0)
#: Two starts empty, two with the load.
_HALF_S = 20.0


def sledge_shift(payloads_kg: Sequence[float] = PAYLOADS_KG, begin_s: float = 0.0) -> pl.DataFrame:
    """The log as a table.

    Args:
        payloads_kg: of the loads.
        begin_s: its first time.
    """
    masses = [EMPTY_KG + extra for payload in payloads_kg for extra in (0.0, payload)]
    parts = [
        sledge(_HALF_S, mass).with_columns(pl.col("time_s") + begin_s + number * _HALF_S)
        for number, mass in enumerate([*masses, EMPTY_KG])
    ]
    return pl.concat(parts)


def write_parts(table: pl.DataFrame, folder: Path, parts: int, overlap_s: float) -> list[Path]:
    """The table as logs of the same length that each begin before the one before ends."""
    folder.mkdir(parents=True, exist_ok=True)
    first, last = (float(x) for x in (table["time_s"][0], table["time_s"][-1]))
    step = (last - first) / parts
    paths: list[Path] = []
    for number in range(parts):
        begin, end = first + number * step - overlap_s, first + (number + 1) * step
        end = end if number < parts - 1 else last + 1.0
        paths.append(folder / f"part_{number}.csv")
        table.filter(pl.col("time_s").is_between(begin, end, closed="left")).write_csv(paths[-1])
    return paths
