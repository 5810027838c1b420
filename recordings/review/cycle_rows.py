"""The table of cycles: one declaration of its columns, and a row of cells by it."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import polars as pl

from analysis.model.physical_units import NS_PER_S
from recordings.report.clock_text import ShiftClock
from recordings.report.shift_text import K
from recordings.review.review_state import RECORDING
from recordings.review.reviewer_verdicts import LABELS, CycleVerdict
from recordings.review.shift_ledger import remark

_KM_H: Final = 3.6
Row = Mapping[str, Any]


class CycleColumn(NamedTuple):
    """A column of numbers: its head, where its value comes from, and digits after the point."""

    head: str
    value: Callable[[Row], float | None]
    digits: int = 0


def _times(factor: float, name: str) -> Callable[[Row], float | None]:
    """A column of the ledger in another unit."""

    def value(row: Row) -> float | None:
        return None if row[name] is None else factor * row[name]

    return value


#: The answer, beside which quality and verdict stand.
PAYLOAD: Final = (
    CycleColumn("payload kg", _times(1.0, "payload_kg")),
    CycleColumn("± kg", _times(K, "payload_u_kg")),
)
#: What else is known of a cycle.
DETAILS: Final = (
    CycleColumn("carried back kg", _times(1.0, "carry_back_kg")),
    CycleColumn("haul m", _times(1.0, "haul_m")),
    CycleColumn("top km/h", _times(_KM_H, "top_speed_m_s"), 1),
    CycleColumn("moving s", _times(1.0, "moving_s")),
    CycleColumn("standing s", _times(1.0, "standing_s")),
    CycleColumn("return s", _times(1.0, "return_s")),
    CycleColumn("load s", _times(1.0, "load_s")),
    CycleColumn("haul s", _times(1.0, "haul_s")),
    CycleColumn("dump s", _times(1.0, "dump_s")),
    CycleColumn("kWh", _times(1.0, "energy_kWh"), 4),
    CycleColumn("± kWh", _times(K, "energy_u_kWh"), 4),
    CycleColumn("kWh/t", _times(1.0, "energy_per_t_kWh"), 3),
)


def _cells(row: Row, columns: Sequence[CycleColumn]) -> list[str]:
    """Numbers as texts; a dash where there is none."""
    values = [(column, column.value(row)) for column in columns]
    return ["–" if value is None else f"{value:,.{column.digits}f}" for column, value in values]


def cycle_rows(
    rows: pl.DataFrame, verdicts: Mapping[int, CycleVerdict], clock: ShiftClock
) -> list[Row]:
    """What the page's table shows of each cycle.

    Args:
        rows: the ledger.
        verdicts: on cycles, by row.
        clock: of the shift.
    """
    return [_row(row, verdicts.get(k), clock) for k, row in enumerate(rows.iter_rows(named=True))]


def _row(row: Row, verdict: CycleVerdict | None, clock: ShiftClock) -> Row:
    labels = [row[name] for name in LABELS if row[name]]
    by = "" if verdict is None else f"{verdict.author}, {clock.day_and_time(verdict.time)}"
    own = None if verdict is None else verdict.model_dump(include={"reject", "note", *LABELS})
    return {
        "number": row["cycle"],
        "id": row["id"],
        "time": row["local_time"],
        "ends_s": round(row["end_unix_ns"] / NS_PER_S),
        "payload": _cells(row, PAYLOAD),
        "details": _cells(row, DETAILS),
        "quality": "rejected" if row["rejected"] else row["quality"],
        "remark": remark(row),
        "labels": ", ".join(labels),
        "note": ": ".join(filter(None, (by, row["note"]))),
        "said": "" if own is None else json.dumps(own),
        "out": not row["counted"],
        "command": f"payscope view {RECORDING} --at {max(row['at_s'], 0.0):.1f}",
    }
