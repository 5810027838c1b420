"""Render the page of a week: days, machines and products of reviewed shifts, after verdicts.

Reviewed shifts of a week are read first, with what is missing in them and trends of friction.
"""

import datetime as dt
import os
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from analysis.cycles.friction_trend import FrictionDay, FrictionTrend, fit_daily_friction_trend
from analysis.model.physical_units import NS
from estimators.errors import OutputError, format_count
from recordings.report.atomic_output import stage_output_file
from recordings.report.number_text import SCALE_NOT_KNOWN, format_plus_minus
from recordings.report.render_page import render_page_html
from recordings.report.shift_text import K, format_tonnes
from recordings.report.svg_shapes import WIDTH, Axes, Drawing
from recordings.review.review_limits import LIMITS
from recordings.review.review_page import PAGE
from recordings.review.review_state import ReviewState, read_review_state
from recordings.review.shift_facts import (
    describe_truncated_logs,
    format_spans_of_recording_gaps,
    list_losses_besides_truncated_ends,
    make_warning_of_mixed_machines,
)
from recordings.review.week_totals import (
    BY_REVIEW,
    GROUPS,
    WeekPart,
    WeekTotal,
    format_machine_title,
    sum_week,
    sum_week_parts_by_group,
)

#: Seconds of a day.
_DAY_S: Final = 86_400.0
_PACKAGE: Final = "recordings.review"
_TEMPLATE: Final = "week.html.j2"
#: Mark in the page of a week, without which an existing file is not replaced.
_MARK: Final = "<!-- payscope week -->"
#: Plot area of the friction, in units of the drawing.
_BOX: Final = (48.0, 22.0, WIDTH - 16.0, 190.0)
#: Column heads of a table of totals, after the name.
HEADS: Final = ("loads", "t ± U", "rejected", "other verdicts", "kWh/t ± U")


class WeekShift(NamedTuple):
    """A reviewed shift of the week, as its review folder states it.

    Attributes:
        folder: folder of its review.
        begins: start, by the machine's clock.
        machine: name and serial number of the machine.
        missing: sentences on data missing from all totals.
        friction: friction of the joint fit; None without one, or without a date.
    """

    folder: Path
    begins: str
    machine: str
    missing: tuple[str, ...]
    friction: FrictionDay | None


def read_shifts_of_reviews(folders: Sequence[Path]) -> list[WeekShift]:
    """Read the shifts of review folders, in order of time; other folders are skipped."""
    states = [
        (folder, state) for folder in folders if (state := read_review_state(folder)) is not None
    ]
    states.sort(key=lambda pair: pair[1].t0_unix_ns)
    return [
        WeekShift(
            folder,
            state.begins,
            format_machine_title(state),
            tuple(_describe_uncounted_work_of_shift(state)),
            _read_friction_of_shift_day(state),
        )
        for folder, state in states
    ]


def _describe_uncounted_work_of_shift(state: ReviewState) -> Iterable[str]:
    if state.mixed_machines:
        yield make_warning_of_mixed_machines(state)
    if gaps := format_spans_of_recording_gaps(state):
        yield f"Readings are missing {gaps}."
    yield from describe_truncated_logs(state)
    yield from list_losses_besides_truncated_ends(state)


def _read_friction_of_shift_day(state: ReviewState) -> FrictionDay | None:
    value, std = state.friction
    if value is None or not std or not state.clock.has_date:
        return None
    middle_s = state.t0_unix_ns / NS + state.duration_s / 2.0
    return FrictionDay(middle_s / _DAY_S, value, std)


def group_friction_by_machine(shifts: Sequence[WeekShift]) -> dict[str, list[FrictionDay]]:
    """Group the friction of shifts by machine, in order of time."""
    found: dict[str, list[FrictionDay]] = defaultdict(list)
    for shift in shifts:
        if shift.friction is not None:
            found[shift.machine].append(shift.friction)
    return dict(found)


def fit_friction_trends(
    shifts: Sequence[WeekShift], limit_N_s_m: float
) -> dict[str, FrictionTrend]:
    """Fit the trend of friction by machine, and estimate when it reaches the limit in N·s/m."""
    by_machine = {
        shift.machine: list[FrictionDay]() for shift in shifts
    } | group_friction_by_machine(shifts)
    return {
        machine: fit_daily_friction_trend(days, limit_N_s_m)
        for machine, days in sorted(by_machine.items())
    }


def format_day_number(day_number: float) -> str:
    """Format the date of a day number, counted from 1970-01-01."""
    try:
        return f"{dt.datetime.fromtimestamp(day_number * _DAY_S, dt.UTC):%Y-%m-%d}"
    except (OverflowError, ValueError, OSError):
        return "a day beyond the calendar"


def describe_friction_trends(trends: Mapping[str, FrictionTrend]) -> list[str]:
    """Describe when each machine's friction reaches the limit, a sentence each."""
    return [
        f"{machine}: {_describe_friction_trend_of_machine(trend)}"
        for machine, trend in trends.items()
    ]


def _describe_friction_trend_of_machine(trend: FrictionTrend) -> str:
    limit = f"{trend.limit_N_s_m:,.0f} N·s/m"
    if trend.slope_N_s_m_d is None or trend.slope_u_N_s_m_d is None or trend.now_N_s_m is None:
        return f"when friction reaches {limit} cannot be predicted: {trend.why_not}"
    change = (
        f"{trend.slope_N_s_m_d:+,.1f} ± {K * trend.slope_u_N_s_m_d:,.1f} N·s/m a day, "
        f"{trend.now_N_s_m:,.0f} N·s/m at the last shift"
    )
    if trend.reached_d is None:
        return f"friction {change}; when it reaches {limit} cannot be predicted: {trend.why_not}"
    first, last = map(format_day_number, trend.reached_d)
    return f"friction {change}; it reaches {limit} between {first} and {last} (95 %)"


def write_week_page(
    week_parts: Sequence[WeekPart],
    shifts: Sequence[WeekShift],
    limit_N_s_m: float | None,
    page_path: Path,
) -> None:
    """Write the page of a week.

    Args:
        week_parts: parts of the week.
        shifts: shifts of the week.
        limit_N_s_m: limit of viscous friction for trends; None for no trends.
        page_path: page to write; an existing page of a week is replaced.

    Raises:
        OutputError: the suffix is not .html, or the existing file is not the page of a week.
    """
    if page_path.suffix != ".html":
        raise OutputError(f"{page_path}: the page of a week is one file; name it like week.html")
    if (
        page_path.is_file()
        and _MARK not in page_path.read_text(encoding="utf-8", errors="replace")[:200]
    ):
        raise OutputError(
            f"{page_path}: exists already and is not a page of a week; give another file"
        )
    with stage_output_file(page_path, overwrites=True) as stage:
        text = render_week_html(week_parts, shifts, limit_N_s_m, page_path.parent)
        stage.write_text(text.replace("<html", f"{_MARK}\n<html", 1), encoding="utf-8")


def render_week_html(
    week_parts: Sequence[WeekPart],
    shifts: Sequence[WeekShift],
    limit_N_s_m: float | None,
    page_folder: Path,
) -> str:
    """Render the page as HTML; arguments as for `write_week_page`, links from `page_folder`."""
    whole = sum_week(week_parts)
    days = sorted({part.day for part in week_parts})
    trends = {} if limit_N_s_m is None else fit_friction_trends(shifts, limit_N_s_m)
    by_review = {each.name: each for each in sum_week_parts_by_group(week_parts, BY_REVIEW)}
    return render_page_html(
        _PACKAGE,
        _TEMPLATE,
        title=f"Week of {', '.join(sorted({shift.machine for shift in shifts}))}",
        days=" to ".join(dict.fromkeys([*days[:1], *days[-1:]])),
        reviews=format_count(len(shifts), "review"),
        headline=describe_week_tonnes(week_parts),
        verdicts=f"{whole.rejected} rejected, {whole.noted} with another verdict",
        heads=list(HEADS),
        tables={
            by: [_make_cells_of_totals(each) for each in sum_week_parts_by_group(week_parts, by)]
            for by in GROUPS
        },
        shifts=[
            _make_shift_row(shift, by_review.get(str(shift.folder)), page_folder)
            for shift in shifts
        ],
        missing=[(shift.begins, text) for shift in shifts for text in shift.missing],
        trends=describe_friction_trends(trends),
        pictures=_draw_friction_pictures(shifts, trends),
    )


def describe_week_tonnes(week_parts: Sequence[WeekPart]) -> str:
    """Describe the tonnes of the week, and whether their ± includes the scale error."""
    whole = sum_week(week_parts)
    scale = "" if all(part.is_scale_known for part in week_parts) else f", {SCALE_NOT_KNOWN}"
    sum_text = format_tonnes(whole.payload_kg, K * whole.payload_u_kg)
    return f"{sum_text} in {format_count(whole.loads, 'load')}{scale}"


def _make_cells_of_totals(week_total: WeekTotal) -> tuple[str, ...]:
    """Make the cells of a row in a table of totals."""
    per_t = "–"
    if week_total.kWh_per_t is not None and week_total.kWh_per_t_u is not None:
        per_t = format_plus_minus(week_total.kWh_per_t, K * week_total.kWh_per_t_u)
    return (
        week_total.name or "not named",
        f"{week_total.loads:,}",
        format_tonnes(week_total.payload_kg, K * week_total.payload_u_kg),
        f"{week_total.rejected}",
        f"{week_total.noted}",
        per_t,
    )


def _make_shift_row(
    shift: WeekShift, shift_total: WeekTotal | None, page_folder: Path
) -> tuple[str, str, tuple[str, ...]]:
    """Make the row of a shift: its start, the link to its page, and the cells of its totals."""
    cells = (
        ("0", "–", "0", "0", "–") if shift_total is None else _make_cells_of_totals(shift_total)[1:]
    )
    page = os.path.relpath(shift.folder / PAGE, page_folder).replace(os.sep, "/")
    return shift.begins, page, (shift.machine, *cells)


def _draw_friction_pictures(
    shifts: Sequence[WeekShift], trends: Mapping[str, FrictionTrend]
) -> list[Drawing]:
    """Draw the friction of each machine with more than one shift."""
    return [
        _draw_friction_picture(number, machine, days, trends.get(machine))
        for number, (machine, days) in enumerate(sorted(group_friction_by_machine(shifts).items()))
        if len(days) > 1
    ]


def _draw_friction_picture(
    picture_number: int, machine: str, days: Sequence[FrictionDay], trend: FrictionTrend | None
) -> Drawing:
    limit = None if trend is None else trend.limit_N_s_m
    ends = [(d.friction_N_s_m - K * d.std_N_s_m, d.friction_N_s_m + K * d.std_N_s_m) for d in days]
    heights = [*(low for low, _ in ends), *(high for _, high in ends)]
    picture = Drawing(
        f"friction-{picture_number}",
        f"Friction of {machine}",
        f"Viscous friction in N·s/m of {len(days)} shifts from {format_day_number(days[0].at_d)} "
        f"to {format_day_number(days[-1].at_d)}; bars reach two standard deviations either way"
        + ("." if limit is None else f"; dashed: the limit, {limit:,.0f} N·s/m."),
        LIMITS.figure_height,
    )
    heights += [] if limit is None else [limit]
    axes = Axes.from_data([day.at_d for day in days], heights, _BOX)
    shown = days[:: max(1, len(days) // 4)]
    axes.draw_grid_and_labels(
        picture,
        "day (UTC)",
        "friction in N·s/m",
        [(d.at_d, format_day_number(d.at_d)[5:]) for d in shown],
    )
    if limit is not None:
        _, y = axes.convert_to_drawing_units(axes.x[0], limit)
        picture.draw_line(_BOX[0], y, _BOX[2], y, "ideal")
    for day, (low, high) in zip(days, ends, strict=True):
        x, bottom = axes.convert_to_drawing_units(day.at_d, low)
        _, top = axes.convert_to_drawing_units(day.at_d, high)
        picture.draw_line(x, bottom, x, top, "axis")
        tip = (
            f"{format_day_number(day.at_d)}: {day.friction_N_s_m:,.0f} ± {K * day.std_N_s_m:,.0f} "
            "N·s/m"
        )
        picture.draw_dot(*axes.convert_to_drawing_units(day.at_d, day.friction_N_s_m), "point", tip)
    return picture
