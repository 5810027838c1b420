"""Render the page of a fleet: one HTML file about machines and weeks."""

import datetime as dt
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from analysis.fleet.calibration_steps import FleetCalibration, LineChange
from analysis.fleet.daily_figures import sum_daily_results_over_machines, sum_tonnes_by_group
from analysis.fleet.machine_drifts import SIGNALS, MachineChart
from estimators.errors import format_count
from recordings.report.number_text import SCALE_NOT_KNOWN
from recordings.report.render_page import render_page_html
from recordings.report.svg_shapes import WIDTH, Axes, Drawing

_BOX: Final = (52.0, 22.0, WIDTH - 8.0, 170.0)
#: Height of a figure in pixels.
_HEIGHT: Final = 206
#: Kilograms of a tonne.
_TONNE: Final = 1e3
#: Days of a week.
_WEEK: Final = 7
#: Control limits of a week's mean, in its standard deviations.
_LIMIT: Final = 3.0
#: Fewest days from which drawn limits are computed; the chart itself needs none.
_BASELINE: Final = 14
_TEMPLATE: Final = "fleet.html.j2"
#: Coverage factor of an interval with a confidence of 95 %.
K: Final = 2.0
#: Most recordings and figures that are shown; further ones are only counted.
MOST_LOOKS: Final = 100
_MOST_FIGURES: Final = 24
_MOST_FAILED: Final = 50
#: Days before its expiry from which a calibration is due.
_DUE_DAYS: Final = 30


@dataclass(frozen=True)
class FleetPage:
    """Contents of a fleet's page.

    Attributes:
        name: name of the fleet.
        results: table `results`.
        days: frame of `summarise_results_by_day`.
        weeks: frame of `sum_weekly_tonnes`.
        charts: charts of `make_machine_charts`.
        calibrations: calibrations of all machines.
        changes: changes between successive calibrations.
        recordings_by_concern: frame of `rank_recordings_by_concern`, with column `command`.
        failed: recordings without a result, and why.
        today: last day of the fleet, against which expiry dates are checked.
        friction: sentences on when each machine's friction reaches a limit, if requested.
    """

    name: str
    results: pl.DataFrame
    days: pl.DataFrame
    weeks: pl.DataFrame
    charts: Sequence[MachineChart]
    calibrations: Sequence[FleetCalibration]
    changes: Sequence[LineChange]
    recordings_by_concern: pl.DataFrame
    failed: Mapping[str, str]
    today: dt.date | None
    friction: Sequence[str] = ()


def render_fleet_html(fleet_page: FleetPage) -> str:
    """Render the page as HTML, with all texts escaped and no external requests."""
    machines = sum_tonnes_by_group(fleet_page.results, ["machine"])
    total, recordings = sum_daily_results_over_machines(machines), fleet_page.recordings_by_concern
    flagged = sorted(
        (chart for chart in fleet_page.charts if chart.chart.flagged_index is not None),
        key=_make_drift_sort_key,
    )
    by_week = _sum_weekly_tonnes_of_fleet(fleet_page.weeks)
    drawn = [draw_weekly_tonnes(by_week)] if by_week.height else []
    return render_page_html(
        "recordings.fleet",
        _TEMPLATE,
        title=f"Fleet {fleet_page.name}",
        period=_format_first_and_last_day(fleet_page.days),
        headline=summarise_fleet(total, machines.height),
        facts=_make_fleet_name_value_rows(fleet_page, total, len(flagged)),
        warnings=_list_fleet_warnings(fleet_page),
        machines=[_make_machine_row(row, fleet_page) for row in machines.iter_rows(named=True)],
        machine_heads=_MACHINE_HEADS,
        pictures=[picture for picture in drawn if picture is not None],
        drifts=[_make_drift_cells(chart) for chart in flagged],
        drift_pictures=[
            draw_drift_chart(n, chart) for n, chart in enumerate(flagged[:_MOST_FIGURES])
        ],
        friction=list(fleet_page.friction),
        drifts_without_picture=max(len(flagged) - _MOST_FIGURES, 0),
        recordings_to_check=[
            {**row, "number": n, "at": f"{row['at_s']:,.0f}"}
            for n, row in enumerate(recordings.head(MOST_LOOKS).to_dicts(), start=1)
        ],
        more_recordings_to_check=max(recordings.height - MOST_LOOKS, 0),
        calibrations=_make_calibration_rows(fleet_page),
        changes=[_format_calibration_line_change(each) for each in fleet_page.changes],
        weeks=_make_tonnes_by_week_table(fleet_page.weeks),
        failed=list(fleet_page.failed.items())[:_MOST_FAILED],
        more_failed=max(len(fleet_page.failed) - _MOST_FAILED, 0),
        signals=SIGNALS,
    )


def summarise_fleet(fleet_total: Mapping[str, float], machines: int) -> str:
    """Summarise a fleet in one line: its tonnes, loads and machines."""
    if not fleet_total["loads"]:
        return f"No tonnes: no cycle of {format_count(machines, 'machine')} has a mass"
    return (
        f"{_format_tonnes_or_dash(fleet_total['payload_kg'], K * fleet_total['payload_u_kg'])} in "
        f"{format_count(int(fleet_total['loads']), 'load')} by {format_count(machines, 'machine')}"
        + (f", {SCALE_NOT_KNOWN}" if fleet_total["without_scale"] else "")
    )


_MACHINE_HEADS: Final = (
    *("machine", "recordings", "loads", "tonnes", "± t", "scale", "hours"),
    *(f"{signal.name} {signal.unit}" for signal in SIGNALS),
    *("calibrated until", "to look at"),
)


def _format_tonnes_or_dash(mass_kg: float, u_kg: float) -> str:
    digits = 0 if u_kg >= 1e4 else 1 if u_kg >= 1e3 else 2
    return f"{mass_kg / 1e3:,.{digits}f} ± {u_kg / 1e3:,.{digits}f} t"


def _format_first_and_last_day(days: pl.DataFrame) -> str:
    if days.is_empty():
        return "no recording has a date"
    return f"{days['day'].min()} to {days['day'].max()}"


def _make_fleet_name_value_rows(
    fleet_page: FleetPage, totals: Mapping[str, float], flagged_charts: int
) -> list[tuple[str, str]]:
    status = fleet_page.results["status"]
    refused = int((status == "refused").sum())
    cannot = fleet_page.results.filter(~pl.col("can_weigh")).height
    return [
        ("interval", "95 % (k = 2); machines are assumed independent of each other"),
        (
            "recordings",
            f"{totals['recordings']:,.0f}: {refused:,} refused, {cannot:,} that cannot weigh, "
            f"{len(fleet_page.failed):,} without a result",
        ),
        ("hours", f"{fleet_page.days['hours'].sum():,.0f} recorded"),
        ("drift", f"{format_count(flagged_charts, 'chart')} beyond the limit"),
        ("to look at", format_count(fleet_page.recordings_by_concern.height, "recording")),
    ]


def _list_fleet_warnings(fleet_page: FleetPage) -> list[str]:
    found: list[str] = []
    versions = sorted(set(fleet_page.results["payscope"]))
    if len(versions) > 1:
        found.append(f"Results of several versions of payscope: {', '.join(versions)}.")
    other = fleet_page.results.filter(~pl.col("current")).height
    if other:
        found.append(
            f"{format_count(other, 'recording')} with other settings or versions than those of the "
            "last run: run the fleet again, where their logs still exist."
        )
    undated = fleet_page.results.filter(pl.col("day") == "undated").height
    if undated:
        found.append(
            f"{format_count(undated, 'recording')} without a date: not in any week or chart."
        )
    scale = int(sum_tonnes_by_group(fleet_page.results, ["machine"])["without_scale"].sum())
    if scale:
        found.append(
            f"Scale not known in {format_count(scale, 'recording')}: neither the empty machine's "
            "stated mass nor a calibration nor the machine file's uncertainties determine it, so "
            "it is not in the ±."
        )
    without = fleet_page.results.filter(
        (pl.col("calibration") == "") & (pl.col("cycles_counted") > 0)
    )
    if fleet_page.calibrations and without.height:
        found.append(f"{format_count(without.height, 'recording')} on days without a calibration.")
    return found


def _make_machine_row(
    machine_totals: Mapping[str, Any], fleet_page: FleetPage
) -> Mapping[str, Any]:
    name = machine_totals["machine"]
    mine = fleet_page.days.filter(pl.col("machine") == name)
    latest = {c.signal.name: c for c in fleet_page.charts if c.machine == name}
    ends = max((c.expires for c in fleet_page.calibrations if c.machine == name), default=None)
    looks = fleet_page.recordings_by_concern.filter(pl.col("machine") == name).height
    cells = [
        format_sortable_cell(machine_totals["recordings"], ",.0f"),
        format_sortable_cell(machine_totals["loads"], ",.0f"),
        format_sortable_cell(machine_totals["payload_kg"] / 1e3, ",.1f"),
        format_sortable_cell(K * machine_totals["payload_u_kg"] / 1e3, ",.1f"),
        ("not known", "1") if machine_totals["without_scale"] else ("known", "0"),
        format_sortable_cell(float(mine["hours"].sum()), ",.0f"),
    ]
    for signal in SIGNALS:
        chart = latest.get(signal.name)
        change = None
        if chart is not None and chart.chart.flagged_index is not None:
            change = chart.flagged_change_in_unit
        cells.append(format_sortable_cell(change, "+,.1f"))
    cells.append(("–", "") if ends is None else (str(ends), str(ends)))
    cells.append(format_sortable_cell(looks, ",.0f"))
    return {"name": name, "cells": cells}


class SortableCell(NamedTuple):
    """Text of a table cell, and the key that it is sorted by."""

    text: str
    sort_key: str


def format_sortable_cell(value: float | None, number_format: str) -> SortableCell:
    """Format a number as text and sorting key of a cell; a dash if it is None or not finite."""
    if value is None or not math.isfinite(value):
        return SortableCell("–", "")
    return SortableCell(f"{value:{number_format}}", f"{value:.6g}")


def _make_drift_sort_key(drift_chart: MachineChart) -> tuple[float, str, str]:
    """Make a sorting key by which the change with the largest ratio to its deviation is first."""
    change, std = abs(drift_chart.flagged_change_in_unit), drift_chart.flagged_change_std_in_unit
    known = math.isfinite(change) and std > 0.0
    return -(change / std if known else 0.0), drift_chart.machine, drift_chart.signal.name


def _make_drift_cells(drift_chart: MachineChart) -> tuple[str, ...]:
    found = drift_chart.chart
    assert found.flagged_index is not None
    assert found.first_shifted_index is not None
    unit = drift_chart.signal.unit
    change, std = drift_chart.flagged_change_in_unit, drift_chart.flagged_change_std_in_unit
    return (
        drift_chart.machine,
        drift_chart.signal.name,
        f"{change:+,.1f} ± {K * std:,.1f} {unit}" if math.isfinite(change) else "–",
        str(drift_chart.days[found.first_shifted_index]),
        str(drift_chart.days[found.flagged_index]),
        drift_chart.signal.means,
    )


def _make_calibration_rows(fleet_page: FleetPage) -> list[tuple[str, ...]]:
    """Make a row for the latest calibration of each machine, the first to expire first."""
    latest: dict[str, FleetCalibration] = {}
    for each in sorted(fleet_page.calibrations, key=lambda c: c.first):
        latest[each.machine] = each
    rows: list[tuple[str, ...]] = []
    for each in sorted(latest.values(), key=lambda c: (c.expires, c.machine)):
        left = None if fleet_page.today is None else (each.expires - fleet_page.today).days
        due = "" if left is None or left > _DUE_DAYS else "due" if left >= 0 else "expired"
        rows.append((each.machine, str(each.first), str(each.expires), due, each.method, each.id))
    return rows


def _format_calibration_line_change(line_change: LineChange) -> tuple[str, ...]:
    return (
        line_change.after.machine,
        str(line_change.before.first),
        str(line_change.after.first),
        f"{line_change.offset_change_kg:+,.1f} (± {line_change.offset_change_limit_kg:,.1f})",
        f"{line_change.slope_change_1:+.2%} (± {line_change.slope_change_limit_1:.2%})",
        "beyond its limit" if line_change.has_line_moved else "within",
    )


def _sum_weekly_tonnes_of_fleet(machine_weeks: pl.DataFrame) -> pl.DataFrame:
    return (
        machine_weeks.group_by("week")
        .agg(pl.col("payload_kg").sum(), (pl.col("payload_u_kg") ** 2).sum().sqrt())
        .sort("week")
    )


def _make_tonnes_by_week_table(machine_weeks: pl.DataFrame) -> Mapping[str, Any]:
    """Make the table of tonnes by machine, with a column per week."""
    if machine_weeks.is_empty():
        return {"heads": [], "rows": []}
    table = machine_weeks.sort("week", "machine").pivot(
        "week", index="machine", values="payload_kg"
    )
    names = sorted(table.columns[1:])
    rows = [
        (
            row["machine"],
            [format_sortable_cell(None if row[n] is None else row[n] / 1e3, ",.1f") for n in names],
        )
        for row in table.sort("machine").iter_rows(named=True)
    ]
    return {"heads": names, "rows": rows}


def draw_weekly_tonnes(machine_weeks: pl.DataFrame) -> Drawing | None:
    """Draw the tonnes of all machines by week; None without weeks.

    Args:
        machine_weeks: frame of week (Date), payload_kg and payload_u_kg, in order of time.
    """
    if machine_weeks.is_empty():
        return None
    t, u = (
        machine_weeks["payload_kg"].to_numpy() / _TONNE,
        machine_weeks["payload_u_kg"].to_numpy() / _TONNE,
    )
    picture = Drawing(
        "tonnes",
        "Tonnes by week",
        f"Tonnes of all machines in {machine_weeks.height} weeks, from {t.min():,.0f} to "
        f"{t.max():,.0f}; "
        "lines reach two standard uncertainties either way.",
        _HEIGHT,
    )
    first = machine_weeks["week"][0]
    at = [(week - first).days / _WEEK for week in machine_weeks["week"]]
    axes = Axes.from_data([-0.5, at[-1] + 0.5], [0.0, float((t + 2.0 * u).max())], _BOX, 0.02)
    axes = Axes(axes.x, (0.0, axes.y[1]), _BOX)
    axes.draw_grid_and_labels(picture, f"weeks since {first}", "tonnes")
    for x, value, half in zip(at, t, 2.0 * u, strict=True):
        left, top = axes.convert_to_drawing_units(x - 0.4, float(value))
        right, bottom = axes.convert_to_drawing_units(x + 0.4, 0.0)
        picture.fill_bar(left, top, right - left, bottom - top, "bar")
        middle, low = axes.convert_to_drawing_units(x, float(value - half))
        _, high = axes.convert_to_drawing_units(x, float(value + half))
        picture.draw_line(middle, low, middle, high, "ideal")
    return picture


def draw_drift_chart(picture_number: int, machine_chart: MachineChart) -> Drawing:
    """Draw a machine's quantity by week, with the control limits of its baseline."""
    flagged, since = machine_chart.chart.flagged_index, machine_chart.chart.first_shifted_index
    assert flagged is not None
    assert since is not None
    values = np.array(machine_chart.values)
    count = min(max(since, _BASELINE), values.size)
    base = values[:count]
    centre, deviation = float(base.mean()), float(base.std(ddof=1))
    points = _average_values_by_week(machine_chart.days, values)
    half = _LIMIT * deviation / np.sqrt(float(np.median([n for _, _, n in points])))
    signal = machine_chart.signal
    unit = {"zero": "kg", "scale": "kg", "friction": "N·s/m"}[signal.name]
    picture = Drawing(
        f"drift-{picture_number}",
        f"{machine_chart.machine}: {signal.name}",
        f"Weekly means of the {signal.means}, in {unit}, with the limits of a week's mean about "
        f"its first {count} days; dashed: {machine_chart.days[flagged]}, when the "
        "chart flagged it.",
        _HEIGHT,
    )
    means = [mean for _, mean, _ in points]
    axes = Axes.from_data(
        [at for at, _, _ in points], [*means, centre - half, centre + half], _BOX, 0.04
    )
    left, top = axes.convert_to_drawing_units(axes.x[0], centre + half)
    right, bottom = axes.convert_to_drawing_units(axes.x[1], centre - half)
    picture.fill_bar(left, top, right - left, bottom - top, "band")
    axes.draw_grid_and_labels(picture, f"weeks since {machine_chart.days[0]}", unit)
    x, _ = axes.convert_to_drawing_units(
        (machine_chart.days[flagged] - machine_chart.days[0]).days / _WEEK, centre
    )
    picture.draw_line(x, _BOX[1], x, _BOX[3], "ideal")
    for at, mean, count in points:
        outside = abs(mean - centre) > half
        week = machine_chart.days[0] + dt.timedelta(days=_WEEK * at)
        tip = f"week of {week}: {mean:,.1f} {unit}, {count} days"
        picture.draw_dot(
            *axes.convert_to_drawing_units(at, mean), "left" if outside else "point", tip
        )
    return picture


class _WeekMean(NamedTuple):
    """Mean of the values of a week."""

    week_number: float
    mean: float
    value_count: int


def _average_values_by_week(days: Sequence[dt.date], values: np.ndarray) -> list[_WeekMean]:
    """Compute the number (from the first day), mean and count of each week with values."""
    number = np.array([(day - days[0]).days // _WEEK for day in days])
    return [
        _WeekMean(float(n), float(values[number == n].mean()), int((number == n).sum()))
        for n in np.unique(number)
    ]
