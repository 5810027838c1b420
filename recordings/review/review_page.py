"""Render the page of a review: one HTML file for phone, desk or paper."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import Any, Final, NamedTuple

import polars as pl

from analysis.cycles.payload_target import TargetCheck
from analysis.cycles.shift_totals import LabelTotal, make_totals_of_counted_cycles
from analysis.model.physical_units import NS, NS_PER_S
from estimators.errors import format_count
from recordings.report.clock_text import ShiftClock, format_duration
from recordings.report.number_text import CONSEQUENCES, format_plus_minus
from recordings.report.render_page import render_page_html
from recordings.report.shift_text import K, format_tonnes
from recordings.review.energy_columns import make_energy_table_by_phase
from recordings.review.review_limits import LIMITS
from recordings.review.review_plots import draw_pictures_of_loads, draw_pictures_of_shift
from recordings.review.review_state import RECORDING, ChangedSetting, ReviewState
from recordings.review.reviewer_verdicts import (
    LABELS,
    VERDICTS,
    CycleVerdict,
    list_verdict_file_lines,
)
from recordings.review.shift_facts import (
    describe_long_gaps,
    describe_missing_loads,
    describe_source_of_mass_scale,
    describe_truncated_logs,
    explain_why_no_cycle_is_counted,
    list_losses_besides_truncated_ends,
    list_shift_names_and_values,
    make_warning_of_mixed_machines,
    summarise_shift_in_line,
)
from recordings.review.shift_ledger import make_cycle_remark, make_cycles_frame

#: km/h per m/s.
_KM_H: Final = 3.6
Row = Mapping[str, Any]
#: Seconds of an hour.
_HOUR_S: Final = 3600.0
#: Column heads of the table of hours, after the hour.
HOUR_HEADS: Final = ("loads", "t ± U", "t/h", "recorded", "not counted", "look again", "kWh")
PAGE: Final = "review.html"
_PACKAGE: Final = "recordings.review"
_TEMPLATE: Final = "review.html.j2"
_SCRIPTS: Final = ("find_rows.js", "verdict_buttons.js")
NOT_CALIBRATED: Final = "Payloads are not calibrated"


class CycleColumn(NamedTuple):
    """A column of numbers: head, source of its value, and decimals."""

    head: str
    value: Callable[[Row], float | None]
    digits: int = 0


def _make_getter_in_other_unit(factor: float, column_name: str) -> Callable[[Row], float | None]:
    """Make a function that returns the value of a ledger column in another unit."""

    def scaled_value(row: Row) -> float | None:
        return None if row[column_name] is None else factor * row[column_name]

    return scaled_value


#: Columns of the payload, beside which quality and verdict are shown.
PAYLOAD: Final = (
    CycleColumn("payload kg", _make_getter_in_other_unit(1.0, "payload_kg")),
    CycleColumn("± kg", _make_getter_in_other_unit(K, "payload_u_kg")),
)
#: Columns of further facts of a cycle.
DETAILS: Final = (
    CycleColumn("carried back kg", _make_getter_in_other_unit(1.0, "carry_back_kg")),
    CycleColumn("haul m", _make_getter_in_other_unit(1.0, "haul_m")),
    CycleColumn("top km/h", _make_getter_in_other_unit(_KM_H, "top_speed_m_s"), 1),
    CycleColumn("moving s", _make_getter_in_other_unit(1.0, "moving_s")),
    CycleColumn("standing s", _make_getter_in_other_unit(1.0, "standing_s")),
    CycleColumn("return s", _make_getter_in_other_unit(1.0, "return_s")),
    CycleColumn("load s", _make_getter_in_other_unit(1.0, "load_s")),
    CycleColumn("haul s", _make_getter_in_other_unit(1.0, "haul_s")),
    CycleColumn("dump s", _make_getter_in_other_unit(1.0, "dump_s")),
    CycleColumn("kWh", _make_getter_in_other_unit(1.0, "energy_kWh"), 4),
    CycleColumn("± kWh", _make_getter_in_other_unit(K, "energy_u_kWh"), 4),
    CycleColumn("kWh/t", _make_getter_in_other_unit(1.0, "energy_per_t_kWh"), 3),
)


def format_number_cells_of_row(ledger_row: Row, columns: Sequence[CycleColumn]) -> list[str]:
    """Format the numbers of a ledger row by columns; a dash for missing ones."""
    values = [(column, column.value(ledger_row)) for column in columns]
    return ["–" if value is None else f"{value:,.{column.digits}f}" for column, value in values]


def make_cycle_table_rows(
    ledger_rows: pl.DataFrame, verdicts: Mapping[int, CycleVerdict], clock: ShiftClock
) -> list[Row]:
    """Make the rows of the page's table of cycles.

    Args:
        ledger_rows: the ledger.
        verdicts: verdicts on cycles, by row.
        clock: clock of the shift.
    """
    return [
        _make_cycle_row(row, verdicts.get(k), clock)
        for k, row in enumerate(ledger_rows.iter_rows(named=True))
    ]


def _make_cycle_row(ledger_row: Row, verdict: CycleVerdict | None, clock: ShiftClock) -> Row:
    labels = [ledger_row[name] for name in LABELS if ledger_row[name]]
    by = "" if verdict is None else f"{verdict.author}, {clock.format_day_and_time(verdict.time)}"
    own = None if verdict is None else verdict.model_dump(include={"reject", "note", *LABELS})
    return {
        "number": ledger_row["cycle"],
        "id": ledger_row["id"],
        "time": ledger_row["local_time"],
        "ends_s": round(ledger_row["end_unix_ns"] / NS_PER_S),
        "payload": format_number_cells_of_row(ledger_row, PAYLOAD),
        "details": format_number_cells_of_row(ledger_row, DETAILS),
        "quality": "rejected" if ledger_row["rejected"] else ledger_row["quality"],
        "remark": make_cycle_remark(ledger_row),
        "labels": ", ".join(labels),
        "note": ": ".join(filter(None, (by, ledger_row["note"]))),
        "said": "" if own is None else json.dumps(own),
        "out": not ledger_row["counted"],
        "command": f"payscope view {RECORDING} --at {max(ledger_row['at_s'], 0.0):.1f}",
    }


def make_hour_table_rows(ledger: pl.DataFrame, state: ReviewState) -> list[tuple[str, ...]]:
    """Make a row per hour of the shift: loads, tonnes, recorded time, uncounted cycles, energy.

    A load belongs to the hour of its dump. The ± of each hour includes uncertainty common to all
    hours, so that the squares do not add up.

    Args:
        ledger: ledger with energy.
        state: state of the review.
    """
    clock, t0_ns = state.clock, state.t0_unix_ns
    hours = [
        clock.format_start_of_hour((ends_ns - t0_ns) / NS) for ends_ns in ledger["end_unix_ns"]
    ]
    named = ledger.with_columns(pl.Series("hour", hours, dtype=pl.String))
    recorded_s = sum_recorded_time_by_hour(clock, state.gaps_s)
    rows = {hour: part for (hour,), part in named.partition_by("hour", as_dict=True).items()}
    return [
        (hour, *_make_hour_cells(rows.get(hour, named.clear()), t0_ns, recorded_s.get(hour, 0.0)))
        for hour in dict.fromkeys([*recorded_s, *hours])
    ]


def _make_hour_cells(ledger_rows: pl.DataFrame, t0_ns: int, recorded_s: float) -> Iterator[str]:
    """Yield the cells of an hour's row, in the order of `HOUR_HEADS`."""
    rejected = ledger_rows.filter("rejected")["cycle"].to_list()
    sums = make_totals_of_counted_cycles(make_cycles_frame(ledger_rows, t0_ns), rejected)
    energies = ledger_rows["energy_kWh"].drop_nulls()
    rate = sums["payload_kg"] / 1e3 / (recorded_s / _HOUR_S) if recorded_s else 0.0
    yield f"{sums['cycles_counted']}"
    yield format_tonnes(sums["payload_kg"], K * sums["payload_u_kg"])
    yield f"{rate:.1f}" if recorded_s >= LIMITS.rate_min_s else "–"
    yield f"{recorded_s / 60.0:.0f} min"
    yield f"{ledger_rows.height - sums['cycles_counted']}"
    yield f"{ledger_rows.filter('counted', pl.col('doubt') != '').height}"
    yield f"{energies.sum():.2f}" if energies.len() else "–"


def sum_recorded_time_by_hour(
    clock: ShiftClock, gaps_s: Iterable[tuple[float, float]]
) -> dict[str, float]:
    """Sum the recorded time in s by clock hour of the shift, without the hours of long gaps."""
    ends_s = [0.0, *chain.from_iterable(sorted(gaps_s)), clock.duration_s]
    recorded_s: dict[str, float] = {}
    for number, (start_s, end_s) in enumerate(pairwise(ends_s)):
        is_gap = number % 2 == 1
        if is_gap and end_s - start_s > LIMITS.gap_by_hour_max_s:
            continue
        while start_s < end_s:
            stop_s = min(clock.compute_next_hour_s(start_s), end_s)
            hour = clock.format_start_of_hour(start_s)
            recorded_s[hour] = recorded_s.get(hour, 0.0) + (0.0 if is_gap else stop_s - start_s)
            start_s = stop_s
    return recorded_s


class UsedCalibration(NamedTuple):
    """Calibration of a review.

    Attributes:
        description: sentence about the calibration; empty without one.
        contradiction_text: why the logs contradict it, so that it is not used; else empty.
    """

    description: str = ""
    contradiction_text: str = ""

    @property
    def has_calibrated_payloads(self) -> bool:
        """Whether the payloads are calibrated by this evidence."""
        return bool(self.description) and not self.contradiction_text


@dataclass(frozen=True)
class ReviewPage:
    """Contents of a page.

    Attributes:
        state: state of the review.
        ledger: ledger with motion.
        shift: frame `shift`, with the reviewers' verdicts applied.
        target: check of the 10/10/20 rule, if a target was given.
        changes: changed settings since the last review; None for the first.
        calibration: calibration of the payloads.
        track: positions, if measured.
        verdicts: file with all verdicts and comments.
        by_row: verdicts on cycles, by row of the ledger.
        totals: totals by label (product, operator …), if loads have labels.
    """

    state: ReviewState
    ledger: pl.DataFrame
    shift: Mapping[str, Any]
    target: TargetCheck | None
    changes: list[ChangedSetting] | None
    calibration: UsedCalibration
    track: pl.DataFrame | None = None
    verdicts: str = ""
    by_row: Mapping[int, CycleVerdict] = field(default_factory=dict[int, CycleVerdict])
    totals: Mapping[str, Sequence[LabelTotal]] = field(
        default_factory=dict[str, Sequence[LabelTotal]]
    )


def render_review_html(review_page: ReviewPage) -> str:
    """Render the page as HTML, with all text escaped and no network access."""
    state, shift = review_page.state, review_page.shift
    why_not = explain_why_no_cycle_is_counted(state, review_page.ledger)
    said = review_page.ledger.filter(pl.col("author") != "").height
    return render_page_html(
        _PACKAGE,
        _TEMPLATE,
        scripts=_SCRIPTS,
        consequence_words=CONSEQUENCES,
        title=f"Shift of {state.machine or 'a machine without a name'}",
        state=state,
        duration=format_duration(shift["duration_s"]),
        calibration_warning=review_page.calibration.contradiction_text
        and f"{NOT_CALIBRATED}: {review_page.calibration.contradiction_text}.",
        headline=summarise_shift_in_line(shift, why_not, state),
        no_tonnes=bool(why_not),
        alarms=list(
            filter(None, (make_warning_of_mixed_machines(state), describe_long_gaps(shift, state)))
        ),
        facts=list_shift_names_and_values(shift, review_page.ledger, state, review_page.target),
        warnings=_list_review_warnings(review_page),
        payload_heads=[column.head for column in PAYLOAD],
        detail_heads=[column.head for column in DETAILS],
        cycles=make_cycle_table_rows(review_page.ledger, review_page.by_row, state.clock),
        t0_s=round(state.t0_unix_ns / NS_PER_S),
        doubted=review_page.ledger.filter("counted", pl.col("doubt") != "").height,
        hours=make_hour_table_rows(review_page.ledger, state),
        hour_heads=list(HOUR_HEADS),
        load_pictures=draw_pictures_of_loads(review_page.ledger, state, review_page.target),
        pictures=draw_pictures_of_shift(state, review_page.track),
        losses=[
            *(each.lost_time_text for each in state.torn),
            *list_losses_besides_truncated_ends(state),
        ],
        totals={name: _make_rows_of_totals(rows) for name, rows in review_page.totals.items()},
        changes=review_page.changes,
        verdicts=f"{format_count(said, 'cycle')} with a reviewer's verdict",
        verdict_lines=list_verdict_file_lines(review_page.verdicts),
        verdict_file=VERDICTS,
        calibration=review_page.calibration.description
        or "none: masses rest on the machine file alone",
        friction=_describe_friction_of_shift(state),
        energy=make_energy_table_by_phase(state),
        energy_phases=[row.phase for row in state.energy.rows if row.cycle is None],
    )


class _TotalRow(NamedTuple):
    """Row of a table of totals, as text."""

    label: str
    load_count: str
    tonnes: str


def _make_rows_of_totals(totals: Sequence[LabelTotal]) -> list[_TotalRow]:
    """Make rows with label, number of loads and tonnes."""
    return [
        _TotalRow(
            each.label or "–",
            f"{each.loads:,}",
            format_tonnes(each.payload_kg, K * each.payload_u_kg),
        )
        for each in totals
    ]


def _list_review_warnings(review_page: ReviewPage) -> list[str]:
    state = review_page.state
    found = describe_missing_loads(review_page.shift)
    found += describe_truncated_logs(state)
    if losses := list_losses_besides_truncated_ends(state):
        found.append(f"Damaged or incomplete: {format_count(len(losses), 'loss')}, listed below.")
    widened = [c.check for c in state.failed if c.consequence == "widen"]
    if widened:
        found.append(f"Checks that failed and widen the ±: {', '.join(widened)}.")
    found += [
        f"These logs show {finding}; payscope explain {RECORDING} says more."
        for finding in state.findings[: LIMITS.max_findings]
    ]
    if review_page.shift["scale_unknown"]:
        found.append(f"Scale {describe_source_of_mass_scale(review_page.shift)}.")
    return found


def _describe_friction_of_shift(state: ReviewState) -> str:
    value, std = state.friction
    return "–" if value is None else f"{format_plus_minus(value, std)} N·s/m (standard uncertainty)"
