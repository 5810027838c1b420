"""Ledger of a shift: frame `cycles` with readable times, doubts and reviewers' verdicts.

Cycles are found in it by number, id or local time.
"""

import datetime as dt
import re
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final, NamedTuple
from zoneinfo import ZoneInfo

import polars as pl

from analysis.cycles.cycle_limits import LIMITS as CYCLE_LIMITS
from analysis.model.check_names import rename_stored_checks
from analysis.model.fingerprint import digest_frame
from analysis.model.physical_units import NS
from analysis.model.schema import FRAMES, QUALITY, conform_frame_to_schema
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import ReviewError, format_count
from recordings.report.clock_text import ShiftClock, format_duration
from recordings.review.energy_columns import add_energy_columns
from recordings.review.review_limits import LIMITS
from recordings.review.review_state import ReviewState
from recordings.review.reviewer_verdicts import LABELS, CycleVerdict, Labels

PARQUET: Final = "ledger.parquet"
CSV: Final = "ledger.csv"
#: Quality of a load that counts, but is worth a second look.
CHECK: Final = "check"
NO_LABELS: Final = Labels()
_QUALITY: Final = ("quality", "withheld_for", "counted")
#: Start of a text that a spreadsheet would compute as a formula; some accept full-width signs too.
FORMULA: Final = "^[=+\\-@\t\r\n\uff1d\uff0b\uff0d\uff20]"
_TIME: Final = re.compile(
    r"(?:(?P<day>\d{4}-\d\d-\d\d)[ T])?(?P<h>\d{1,2}):(?P<m>\d\d)(?::(?P<s>\d\d))?"
    r"\s*(?P<offset>Z|[+-]\d\d:?\d\d)?"
)


def make_cycle_ids(cycles: pl.DataFrame, t0_unix_ns: int) -> pl.Series:
    """Make the ids of cycles: the time of their end, in UTC, or by an undated log's own clock."""
    return pl.Series(
        "id",
        [_make_cycle_id_of_time(t0_unix_ns + t_ns) for t_ns in cycles["end_t_ns"]],
        dtype=pl.String,
    )


def make_ledger_frame(
    cycles: pl.DataFrame,
    t0_unix_ns: int,
    verdicts: Mapping[int, CycleVerdict],
    find_labels_at_time: Callable[[float], Labels] = lambda _: NO_LABELS,
) -> pl.DataFrame:
    """Make the ledger, with a row per cycle.

    The quality is that of the frame, except "check" for a good load with a doubt.

    Args:
        cycles: frame `cycles`.
        t0_unix_ns: origin of the frame's times.
        verdicts: verdicts by row.
        find_labels_at_time: function that returns the labels of a cycle that ends at a Unix time in
            s; the cycle's own labels have precedence.
    """
    rows = [verdicts.get(row) for row in range(cycles.height)]
    shared = [find_labels_at_time((t0_unix_ns + t_ns) / NS) for t_ns in cycles["end_t_ns"]]

    def make_verdict_column(name: str, defaults: Sequence[str]) -> pl.Series:
        pairs = zip(rows, defaults, strict=True)
        texts = [text if each is None else getattr(each, name) or text for each, text in pairs]
        return pl.Series(name, texts, dtype=pl.String)

    rejected = pl.Series(
        "rejected", [each is not None and each.reject for each in rows], dtype=pl.Boolean
    )
    doubts = pl.Series("doubt", describe_doubts_of_each_cycle(cycles), dtype=pl.String)
    times = [
        (pl.col(f"{name}_t_ns") + t0_unix_ns).alias(f"{name}_unix_ns")
        for name in ("start", "end", "dig", "dump")
    ]
    when = ["" if each is None else _format_time_as_iso_8601(each.time) for each in rows]
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


def add_motion_columns(ledger_rows: pl.DataFrame, state: ReviewState) -> pl.DataFrame:
    """Add local times, distances, speeds, standstills and energy to the ledger.

    Args:
        ledger_rows: the ledger.
        state: state of the review.
    """
    clock, motions = state.clock, {each.cycle: each for each in state.motions}
    local = [clock.format_unix_ns(each) for each in ledger_rows["end_unix_ns"]]
    found = [motions.get(each) for each in ledger_rows["cycle"]]
    columns = {
        "haul_m": [None if m is None else m.haul_m for m in found],
        **{
            name: [None if m is None else getattr(m.whole, name) for m in found]
            for name in ("distance_m", "top_speed_m_s", "moving_s", "standing_s", "hole_s")
        },
    }
    moved = ledger_rows.with_columns(
        pl.Series("local_time", local, dtype=pl.String),
        *(pl.Series(name, numbers, dtype=pl.Float64) for name, numbers in columns.items()),
    )
    return add_energy_columns(moved, state)


def make_cycle_remark(ledger_row: Mapping[str, Any]) -> str:
    """Make the remark on a cycle: why it has no mass or needs checking, and its gap.

    Args:
        ledger_row: row of the ledger, with motion.
    """
    hole_s = ledger_row["hole_s"] or 0.0
    hole = f"{format_duration(hole_s)} of it not recorded" if hole_s > LIMITS.cycle_gap_s else ""
    return "; ".join(filter(None, (ledger_row["withheld_for"], ledger_row["doubt"], hole)))


def make_cycles_frame(ledger_rows: pl.DataFrame, t0_unix_ns: int) -> pl.DataFrame:
    """Make the frame `cycles` of a ledger, without verdicts.

    Args:
        ledger_rows: the ledger.
        t0_unix_ns: origin of the frame's times.
    """
    frame = rename_stored_checks("cycles", ledger_rows).with_columns(
        *(
            (pl.col(f"{name}_unix_ns") - t0_unix_ns).alias(f"{name}_t_ns")
            for name in ("start", "end", "dig", "dump")
        ),
        quality=pl.col("quality").replace(CHECK, "good").cast(QUALITY),
        counted=pl.col("quality").is_in(["good", "weak", CHECK]),
    )
    return conform_frame_to_schema("cycles", frame.select(c.name for c in FRAMES["cycles"].columns))


class CycleRows(NamedTuple):
    """Rows of a ledger as written, and its frame `cycles`."""

    ledger: pl.DataFrame
    cycles: pl.DataFrame


def read_cycle_rows_of_review(folder: Path, state: ReviewState) -> CycleRows:
    """Read the ledger of a review, whose cycles must be those that the review wrote.

    Raises:
        OSError: the file cannot be read.
        PolarsError: the file is not a ledger.
        ReviewError: a cycle was changed, added or removed.
    """
    rows = pl.read_parquet(folder / PARQUET)
    cycles = make_cycles_frame(rows, state.t0_unix_ns)
    if state.cycles_sha256 not in ("", digest_frame(cycles)):
        raise ReviewError(
            f"{folder / PARQUET}: was changed since the review wrote it; review its logs again"
        )
    return CycleRows(rows, cycles)


def write_ledger_parquet_and_csv(ledger: pl.DataFrame, folder: Path) -> None:
    """Write the ledger as Parquet and as CSV.

    In the CSV, an apostrophe precedes texts that a spreadsheet would evaluate as formulas.
    """
    # through memory: for a full disk, polars reports only that computing failed
    written = BytesIO()
    ledger.write_parquet(written, compression="zstd")
    (folder / PARQUET).write_bytes(written.getvalue())
    texts = [name for name, kind in ledger.schema.items() if kind == pl.String]
    safe = [
        pl.when(pl.col(name).str.contains(FORMULA))
        .then(pl.lit("'") + pl.col(name))
        .otherwise(pl.col(name))
        .alias(name)
        for name in texts
    ]
    ledger.with_columns(safe).write_csv(folder / CSV, float_precision=3)


def _make_cycle_id_of_time(unix_ns: int) -> str:
    if unix_ns < FIRST_DATE_NS:
        return f"{unix_ns / NS:.0f}s"
    return _format_time_as_iso_8601(dt.datetime.fromtimestamp(unix_ns // NS, dt.UTC))


def _format_time_as_iso_8601(time: dt.datetime) -> str:
    return f"{time.astimezone(dt.UTC):%Y-%m-%dT%H:%M:%SZ}"


def escape_spreadsheet_formula(text: str) -> str:
    """Prefix a text with an apostrophe if a spreadsheet would evaluate it as a formula."""
    return f"'{text}" if re.match(FORMULA, text) else text


def find_ledger_row_of_cycle(time_text: str, ledger_rows: pl.DataFrame, clock: ShiftClock) -> int:
    """Find the row of the cycle that a reviewer names.

    A local time selects the cycle dumped within 5 s of it or in that minute, else the one in
    progress.

    Args:
        time_text: a number (14), an id (2023-11-14T22:14:58Z) or a local time (14:32:10, 14:32,
            02:30:10+02:00, 2023-11-14 14:32:10); h:mm:ss since the start for a log without a date.
        ledger_rows: the ledger.
        clock: clock of the shift.

    Raises:
        ReviewError: no cycle matches, or several do.
    """
    text = time_text.strip()
    if text.isdecimal():
        found = [k for k, number in enumerate(ledger_rows["cycle"]) if number == int(text)]
    elif text in (ids := ledger_rows["id"].to_list()):
        found = [ids.index(text)]
    elif match := _TIME.fullmatch(text):
        try:
            found = find_ledger_rows_at_time(match, ledger_rows, clock)
        except ValueError as error:  # 30 February, an offset of 25 h
            raise ReviewError(f"'{time_text}' is not a time ({error})") from None
    else:
        raise ReviewError(
            f"'{time_text}' names no cycle; "
            f"give its number (14), its id, or a local time (14:32:10)"
        )
    if len(found) > 1:
        choices = ", ".join(
            f"{ledger_rows['cycle'][k]} (dumped {ledger_rows['local_time'][k]})" for k in found
        )
        raise ReviewError(
            f"'{time_text}' may be cycle {choices}; give the number, or the UTC offset"
        )
    if not found:
        span = (
            f" from {ledger_rows['local_time'][0]} to {ledger_rows['local_time'][-1]}"
            if ledger_rows.height
            else ""
        )
        raise ReviewError(
            f"no cycle '{time_text}' among {format_count(ledger_rows.height, 'cycle')}{span}; take "
            "the number or id from the ledger"
        )
    return found[0]


def parse_local_instant(text: str, clock: ShiftClock) -> dt.datetime:
    """Parse the instant at which the local clock shows a time; see `find_ledger_row_of_cycle`.

    Raises:
        ReviewError: the text is not a time, or the clock shows the time never or twice.
    """
    match = _TIME.fullmatch(text.strip())
    try:
        found = [] if match is None else convert_local_time_to_unix_s(match, clock)
    except ValueError as error:
        raise ReviewError(f"'{text}' is not a time ({error})") from None
    if match is None:
        raise ReviewError(f"'{text}' is not a time; write it like 14:32 or 2023-11-14 14:32:10")
    start_s = clock.t0_unix_ns / NS
    within_shift = [each for each in found if 0.0 <= each - start_s <= clock.duration_s]
    # in a shift over midnight, the same hour of the other day is outside the shift
    found = within_shift or found
    if len(found) != 1:
        times = "never" if not found else f"{len(found)} times"
        raise ReviewError(
            f"the shift's clock shows '{text}' {times}; give the day and the UTC offset as well"
        )
    return dt.datetime.fromtimestamp(found[0], dt.UTC)


def find_ledger_rows_at_time(
    time_match: re.Match[str], ledger_rows: pl.DataFrame, clock: ShiftClock
) -> list[int]:
    """Find the rows of cycles that a time may select."""
    starts, ends = ledger_rows["start_unix_ns"].to_list(), ledger_rows["end_unix_ns"].to_list()
    room_s = 60.0 if time_match["s"] is None else 0.0
    found: set[int] = set()
    for unix_s in convert_local_time_to_unix_s(time_match, clock):
        dumped = {
            k: abs(end / NS - unix_s)
            for k, end in enumerate(ends)
            if unix_s - (0.0 if room_s else LIMITS.near_dump_s)
            <= end / NS
            < unix_s + (room_s or LIMITS.near_dump_s)
        }
        if dumped:
            found |= set(dumped) if room_s else {min(dumped, key=dumped.__getitem__)}
            continue
        spans = enumerate(zip(starts, ends, strict=True))
        found |= {k for k, (s, e) in spans if s / NS <= unix_s <= e / NS}
    return sorted(found)


def convert_local_time_to_unix_s(time_match: re.Match[str], clock: ShiftClock) -> list[float]:
    """Convert a local time to the Unix times in s at which the clock shows it, none to several."""
    hour, minute, second = (int(time_match[name] or 0) for name in ("h", "m", "s"))
    if not clock.has_date:
        return [clock.t0_unix_ns / NS + 3600 * hour + 60 * minute + second]
    zone = _parse_utc_offset(time_match["offset"]) if time_match["offset"] else ZoneInfo(clock.zone)
    first, last = (
        clock.to_local_datetime(s).astimezone(zone).date() for s in (0.0, clock.duration_s)
    )
    days = [first + dt.timedelta(days=k) for k in range((last - first).days + 1)]
    if time_match["day"]:
        days = [dt.date.fromisoformat(time_match["day"])]
    found: set[float] = set()
    for day in days:
        for fold in (0, 1):
            wall = dt.datetime.combine(day, dt.time(hour, minute, second, fold=fold), zone)
            # a clock that is set forward never shows the hour between
            utc = wall.astimezone(dt.UTC)
            if utc.astimezone(zone).replace(tzinfo=None) == wall.replace(tzinfo=None):
                found.add(utc.timestamp())
    return sorted(found)


def _parse_utc_offset(text: str) -> dt.timezone:
    if text == "Z":
        return dt.UTC
    sign, digits = (-1 if text[0] == "-" else 1), text[1:].replace(":", "")
    return dt.timezone(sign * dt.timedelta(hours=int(digits[:2]), minutes=int(digits[2:])))


def describe_doubts_of_each_cycle(cycle_rows: pl.DataFrame) -> list[str]:
    """Describe the doubts about each cycle, joined by semicolons; "" without doubts or payload.

    Args:
        cycle_rows: frame `cycles`, as counted.
    """
    counted = cycle_rows.filter("counted")["payload_kg"]
    typical = spread = None
    if counted.len() >= CYCLE_LIMITS.unlike_load_min_loads:
        typical = counted.median()
        spread = (counted - typical).abs().median()
    return [
        _describe_cycle_doubts(row, typical, spread) for row in cycle_rows.iter_rows(named=True)
    ]


def _describe_cycle_doubts(
    cycle_row: Mapping[str, Any], typical_kg: Any, median_deviation_kg: Any
) -> str:
    """Describe the doubts about one cycle, joined by semicolons; "" without doubts."""
    payload_kg, u_kg = cycle_row["payload_kg"], cycle_row["payload_u_kg"]
    if payload_kg is None or not cycle_row["counted"]:
        return ""
    found: list[str] = []
    if payload_kg - CYCLE_LIMITS.coverage_factor * u_kg <= 0.0:
        found.append("the payload may be zero")
    back_kg, back_u_kg = cycle_row["carry_back_kg"], cycle_row["carry_back_u_kg"]
    if (
        back_kg is not None
        and back_u_kg is not None
        and abs(back_kg) > CYCLE_LIMITS.coverage_factor * back_u_kg
    ):
        if back_kg < 0.0:
            found.append(
                f"after the dump {-back_kg:,.0f} kg less than empty: the weighing is wrong"
            )
        elif back_kg > CYCLE_LIMITS.max_carried_fraction * abs(payload_kg):
            found.append(f"after the dump {back_kg:,.0f} kg still in the bucket")
    if typical_kg is not None:
        room_kg = CYCLE_LIMITS.unlike_load_std * float(
            (STD_OF_MAD**2 * median_deviation_kg**2 + u_kg**2) ** 0.5
        )
        if abs(payload_kg - typical_kg) > room_kg:
            found.append(f"unlike the other payloads, which are about {typical_kg:,.0f} kg")
    return "; ".join(found)
