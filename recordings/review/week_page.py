"""Page of a week: days, machines and products of reviewed shifts, with verdicts applied."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from analysis.cycles.friction_trend import FrictionDay, FrictionTrend
from estimators.errors import OutputError, counted
from recordings.report.atomic_output import atomic_file
from recordings.report.number_text import SCALE_NOT_KNOWN, format_plus_minus
from recordings.report.render_page import render_page_html
from recordings.report.shift_text import K, format_tonnes
from recordings.report.svg_shapes import WIDTH, Axes, Drawing
from recordings.review.review_page import PAGE
from recordings.review.week_shifts import (
    WeekShift,
    day_text,
    friction_by_machine,
    friction_trend_by_machine,
    trend_sentences,
)
from recordings.review.week_totals import (
    BY_REVIEW,
    GROUPS,
    WeekPart,
    WeekTotal,
    total_of_week,
    totals_by_group,
)

_PACKAGE: Final = "recordings.review"
_TEMPLATE: Final = "week.html.j2"
#: What the page of a week holds, so that no other file is replaced by one.
_MARK: Final = "<!-- payscope week -->"
#: Plot area of the friction, in units of the drawing,
_BOX: Final = (48.0, 22.0, WIDTH - 16.0, 190.0)
#: and height of the figure, likewise.
_HEIGHT: Final = 226
#: Heads of a table of totals, behind the name.
HEADS: Final = ("loads", "t ± U", "rejected", "other verdicts", "kWh/t ± U")


def write_week_page(
    parts: Sequence[WeekPart],
    shifts: Sequence[WeekShift],
    limit_N_s_m: float | None,
    path: Path,
) -> None:
    """Write the page of a week.

    Args:
        parts: parts of the week.
        shifts: shifts of the week.
        limit_N_s_m: limit of friction, if requested.
        path: page to write; an existing page of a week is replaced.

    Raises:
        OutputError: it is not .html, or another file exists there.
    """
    if path.suffix != ".html":
        raise OutputError(f"{path}: the page of a week is one file; name it like week.html")
    if path.is_file() and _MARK not in path.read_text(encoding="utf-8", errors="replace")[:200]:
        raise OutputError(f"{path}: exists already and is not a page of a week; name another file")
    with atomic_file(path, force=True) as stage:
        text = render_week_html(parts, shifts, limit_N_s_m, path.parent)
        stage.write_text(text.replace("<html", f"{_MARK}\n<html", 1), encoding="utf-8")


def render_week_html(
    parts: Sequence[WeekPart],
    shifts: Sequence[WeekShift],
    limit_N_s_m: float | None,
    folder: Path,
) -> str:
    """HTML of the page; arguments as for `write_week_page`, links are relative to `folder`."""
    whole = total_of_week(parts)
    days = sorted({part.day for part in parts})
    trends = {} if limit_N_s_m is None else friction_trend_by_machine(shifts, limit_N_s_m)
    by_review = {each.name: each for each in totals_by_group(parts, BY_REVIEW)}
    return render_page_html(
        _PACKAGE,
        _TEMPLATE,
        title=f"Week of {', '.join(sorted({shift.machine for shift in shifts}))}",
        days=" to ".join(dict.fromkeys([*days[:1], *days[-1:]])),
        reviews=counted(len(shifts), "review"),
        headline=week_tonnes_sentence(parts),
        verdicts=f"{whole.rejected} rejected, {whole.noted} with another verdict",
        heads=list(HEADS),
        tables={
            by: [_make_total_cells(each) for each in totals_by_group(parts, by)] for by in GROUPS
        },
        shifts=[
            _list_shift_begin_link_and_cells(shift, by_review.get(str(shift.folder)), folder)
            for shift in shifts
        ],
        missing=[(shift.begins, text) for shift in shifts for text in shift.missing],
        trends=trend_sentences(trends),
        pictures=_draw_friction_pictures(shifts, trends),
    )


def week_tonnes_sentence(parts: Sequence[WeekPart]) -> str:
    """Tonnes of the week, and whether their ± includes the error of scale."""
    whole = total_of_week(parts)
    scale = "" if all(part.scale_known for part in parts) else f", {SCALE_NOT_KNOWN}"
    sum_text = format_tonnes(whole.payload_kg, K * whole.payload_u_kg)
    return f"{sum_text} in {counted(whole.loads, 'load')}{scale}"


def _make_total_cells(total: WeekTotal) -> tuple[str, ...]:
    """Cells of a row in a table of totals."""
    per_t = "–"
    if total.kWh_per_t is not None and total.kWh_per_t_u is not None:
        per_t = format_plus_minus(total.kWh_per_t, K * total.kWh_per_t_u)
    return (
        total.name or "not named",
        f"{total.loads:,}",
        format_tonnes(total.payload_kg, K * total.payload_u_kg),
        f"{total.rejected}",
        f"{total.noted}",
        per_t,
    )


def _list_shift_begin_link_and_cells(
    shift: WeekShift, total: WeekTotal | None, folder: Path
) -> tuple[str, str, tuple[str, ...]]:
    """Start of a shift, link to its page, and cells of its totals."""
    cells = ("0", "–", "0", "0", "–") if total is None else _make_total_cells(total)[1:]
    page = os.path.relpath(shift.folder / PAGE, folder).replace(os.sep, "/")
    return shift.begins, page, (shift.machine, *cells)


def _draw_friction_pictures(
    shifts: Sequence[WeekShift], trends: Mapping[str, FrictionTrend]
) -> list[Drawing]:
    """Pictures of the friction of machines with more than one shift."""
    return [
        _draw_friction_picture(number, machine, days, trends.get(machine))
        for number, (machine, days) in enumerate(sorted(friction_by_machine(shifts).items()))
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
        f"Viscous friction in N·s/m of {len(days)} shifts from {day_text(days[0].at_d)} to "
        f"{day_text(days[-1].at_d)}; bars reach two standard deviations either way"
        + ("." if limit is None else f"; dashed: the limit, {limit:,.0f} N·s/m."),
        _HEIGHT,
    )
    heights += [] if limit is None else [limit]
    axes = Axes.from_data([day.at_d for day in days], heights, _BOX)
    shown = days[:: max(1, len(days) // 4)]
    axes.draw(
        picture, "day (UTC)", "friction in N·s/m", [(d.at_d, day_text(d.at_d)[5:]) for d in shown]
    )
    if limit is not None:
        _, y = axes.place_in_drawing(axes.x[0], limit)
        picture.draw_line(_BOX[0], y, _BOX[2], y, "ideal")
    for day, (low, high) in zip(days, ends, strict=True):
        x, bottom = axes.place_in_drawing(day.at_d, low)
        _, top = axes.place_in_drawing(day.at_d, high)
        picture.draw_line(x, bottom, x, top, "axis")
        tip = f"{day_text(day.at_d)}: {day.friction_N_s_m:,.0f} ± {K * day.std_N_s_m:,.0f} N·s/m"
        picture.draw_dot(*axes.place_in_drawing(day.at_d, day.friction_N_s_m), "point", tip)
    return picture
