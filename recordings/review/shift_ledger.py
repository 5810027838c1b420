"""Ledger of a shift: frame `cycles` with readable times and reviewers' verdicts."""

import datetime as dt
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.cycles.cycle_doubts import list_cycle_doubts
from analysis.model.check_names import rename_stored_checks
from analysis.model.physical_units import NS
from analysis.model.schema import FRAMES, QUALITY, conform_to_schema
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.report.clock_text import duration_text
from recordings.review.energy_columns import add_energy_columns
from recordings.review.review_state import ReviewState
from recordings.review.reviewer_verdicts import LABELS, CycleVerdict, Labels

PARQUET: Final = "ledger.parquet"
CSV: Final = "ledger.csv"
#: Quality of a load that counts and is worth a second look.
CHECK: Final = "check"
#: A cycle with a longer hole in it, in s, says so, and is left out of the mean times.
HOLE_S: Final = 5.0
NO_LABELS: Final = Labels()
_QUALITY: Final = ("quality", "withheld_for", "counted")
#: How a text begins that a spreadsheet computes.
FORMULA: Final = r"^[=+\-@\t\r]"


def make_cycle_ids(cycles: pl.DataFrame, t0_unix_ns: int) -> pl.Series:
    """Ids of cycles: the time of their end, in UTC, or by an undated log's own clock."""
    return pl.Series(
        "id", [_make_cycle_id(t0_unix_ns + t_ns) for t_ns in cycles["end_t_ns"]], dtype=pl.String
    )


def make_ledger(
    cycles: pl.DataFrame,
    t0_unix_ns: int,
    verdicts: Mapping[int, CycleVerdict],
    labels_at: Callable[[float], Labels] = lambda _: NO_LABELS,
) -> pl.DataFrame:
    """Ledger with one row per cycle.

    The quality is that of the frame, except "check" for a good load with a doubt.

    Args:
        cycles: frame `cycles`.
        t0_unix_ns: origin of the frame's times.
        verdicts: verdicts by row.
        labels_at: labels of cycles that end at a unix time in s; the verdict's own labels precede
            them.
    """
    rows = [verdicts.get(row) for row in range(cycles.height)]
    shared = [labels_at((t0_unix_ns + t_ns) / NS) for t_ns in cycles["end_t_ns"]]

    def make_verdict_column(name: str, defaults: Sequence[str]) -> pl.Series:
        pairs = zip(rows, defaults, strict=True)
        texts = [text if each is None else getattr(each, name) or text for each, text in pairs]
        return pl.Series(name, texts, dtype=pl.String)

    rejected = pl.Series(
        "rejected", [each is not None and each.reject for each in rows], dtype=pl.Boolean
    )
    doubts = pl.Series("doubt", list_cycle_doubts(cycles), dtype=pl.String)
    times = [
        (pl.col(f"{name}_t_ns") + t0_unix_ns).alias(f"{name}_unix_ns")
        for name in ("start", "end", "dig", "dump")
    ]
    when = ["" if each is None else _format_iso_time(each.time) for each in rows]
    return cycles.select(
        "cycle",
        make_cycle_ids(cycles, t0_unix_ns),
        *times,
        (pl.col("start_t_ns") / NS).alias("at_s"),
        pl.exclude("cycle", "start_t_ns", "end_t_ns", "dig_t_ns", "dump_t_ns", *_QUALITY),
        pl.when((doubts != "") & (pl.col("quality") == "good"))
        .then(pl.lit(CHECK))
        .otherwise(pl.col("quality").cast(pl.String))
        .alias("quality"),
        "withheld_for",
        doubts,
        (pl.col("counted") & ~rejected).alias("counted"),
        rejected,
        *(
            make_verdict_column(name, [getattr(labels, name) for labels in shared])
            for name in LABELS
        ),
        make_verdict_column("note", [""] * cycles.height),
        make_verdict_column("author", [""] * cycles.height),
        pl.Series("said", when, dtype=pl.String),
    )


def add_motion_columns(rows: pl.DataFrame, state: ReviewState) -> pl.DataFrame:
    """Ledger with local times, distances, speeds, standstills and energy by cycle number.

    Args:
        rows: the ledger.
        state: state of the review.
    """
    clock, motions = state.clock, {each.cycle: each for each in state.motions}
    local = [clock.format_unix_ns(each) for each in rows["end_unix_ns"]]
    found = [motions.get(each) for each in rows["cycle"]]
    columns = {
        "haul_m": [None if m is None else m.haul_m for m in found],
        **{
            name: [None if m is None else getattr(m.whole, name) for m in found]
            for name in ("distance_m", "top_speed_m_s", "moving_s", "standing_s", "hole_s")
        },
    }
    moved = rows.with_columns(
        pl.Series("local_time", local, dtype=pl.String),
        *(pl.Series(name, numbers, dtype=pl.Float64) for name, numbers in columns.items()),
    )
    return add_energy_columns(moved, state)


def cycle_remark_text(row: Mapping[str, Any]) -> str:
    """Remark on a cycle: why it has no mass or needs checking, or its gap.

    Args:
        row: row of the ledger, with motion.
    """
    hole_s = row["hole_s"] or 0.0
    hole = f"{duration_text(hole_s)} of it not recorded" if hole_s > HOLE_S else ""
    return "; ".join(filter(None, (row["withheld_for"], row["doubt"], hole)))


def cycles_frame_from_ledger(rows: pl.DataFrame, t0_unix_ns: int) -> pl.DataFrame:
    """Frame `cycles` of a ledger, without verdicts.

    Args:
        rows: the ledger.
        t0_unix_ns: origin of the frame's times.
    """
    frame = rename_stored_checks("cycles", rows).with_columns(
        *(
            (pl.col(f"{name}_unix_ns") - t0_unix_ns).alias(f"{name}_t_ns")
            for name in ("start", "end", "dig", "dump")
        ),
        quality=pl.col("quality").replace(CHECK, "good").cast(QUALITY),
        counted=pl.col("quality").is_in(["good", "weak", CHECK]),
    )
    return conform_to_schema("cycles", frame.select(c.name for c in FRAMES["cycles"].columns))


def write_ledger(frame: pl.DataFrame, folder: Path) -> None:
    """Write the ledger as Parquet and as CSV.

    In the CSV, an apostrophe precedes texts that a spreadsheet would evaluate as formulas.
    """
    frame.write_parquet(folder / PARQUET, compression="zstd")
    texts = [name for name, kind in frame.schema.items() if kind == pl.String]
    safe = [
        pl.when(pl.col(name).str.contains(FORMULA))
        .then(pl.lit("'") + pl.col(name))
        .otherwise(pl.col(name))
        .alias(name)
        for name in texts
    ]
    frame.with_columns(safe).write_csv(folder / CSV, float_precision=3)


def _make_cycle_id(unix_ns: int) -> str:
    if unix_ns < FIRST_DATE_NS:
        return f"{unix_ns / NS:.0f}s"
    return _format_iso_time(dt.datetime.fromtimestamp(unix_ns // NS, dt.UTC))


def _format_iso_time(time: dt.datetime) -> str:
    return f"{time.astimezone(dt.UTC):%Y-%m-%dT%H:%M:%SZ}"


def escape_spreadsheet_formula(text: str) -> str:
    """Text, after an apostrophe if a spreadsheet would evaluate it."""
    return f"'{text}" if re.match(FORMULA, text) else text
