"""The command `fleet report`: write one page about all machines and weeks of a fleet."""

import datetime as dt
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.cycles.friction_trend import FrictionDay, FrictionTrend, fit_daily_friction_trend
from analysis.fleet.calibration_steps import find_line_changes
from analysis.fleet.daily_figures import (
    UNDATED,
    rank_recordings_by_concern,
    sum_daily_results_over_machines,
    sum_tonnes_by_group,
    sum_weekly_tonnes,
    summarise_results_by_day,
)
from analysis.fleet.machine_drifts import MachineChart, make_machine_charts
from recordings.fleet.fleet_page import FleetPage, render_fleet_html
from recordings.report.atomic_output import stage_output_file
from recordings.review.week_page import describe_friction_trends
from replay.fleet.engine_limits import LIMITS
from replay.fleet.gathered_tables import FleetResults

#: Nanoseconds of a day.
_DAY_NS: Final = 86_400 * 10**9


@dataclass(frozen=True)
class FleetReport:
    """The written report of a fleet.

    Attributes:
        page: contents of the page.
        path: path of the written page.
        friction: friction trend of each machine, if a limit was given.
    """

    page: FleetPage
    path: Path
    friction: Mapping[str, FrictionTrend]

    def to_dict(self) -> dict[str, Any]:
        """Sums, drifts and recordings that need attention, as plain JSON values."""
        page = self.page
        machines = sum_tonnes_by_group(page.results, ["machine"])
        return {
            "page": str(self.path),
            "sum": dict(sum_daily_results_over_machines(machines)),
            "machines": machines.to_dicts(),
            "drifts": [
                _convert_drift_to_dict(c) for c in page.charts if c.chart.flagged_index is not None
            ],
            "friction": {name: trend._asdict() for name, trend in self.friction.items()},
            "to_look_at": page.recordings_by_concern.to_dicts(),
            "without_a_result": dict(page.failed),
        }


def write_fleet_report(
    results: FleetResults,
    destination: str,
    fleet_name: str,
    page_path: Path,
    *,
    overwrites: bool = False,
    friction_limit_N_s_m: float | None = None,
) -> FleetReport:
    """Write the page of a fleet.

    Args:
        results: results of the fleet.
        destination: destination of the results, for the commands on the page.
        fleet_name: name of the fleet.
        page_path: path of the page to write.
        overwrites: whether an existing page may be replaced.
        friction_limit_N_s_m: viscous friction for which to estimate the day on which each machine
            reaches it; None for no estimate.

    Raises:
        OutputError: the page exists, or cannot be written.
    """
    with stage_output_file(page_path, overwrites=overwrites) as written:
        shown = make_fleet_page(results, destination, fleet_name)
        trends: dict[str, FrictionTrend] = {}
        if friction_limit_N_s_m is not None:
            trends = estimate_fleet_friction_trends(shown.results, friction_limit_N_s_m)
            shown = replace(shown, friction=describe_friction_trends(trends))
        written.write_text(render_fleet_html(shown), encoding="utf-8")
    return FleetReport(shown, page_path, trends)


def make_fleet_page(results: FleetResults, destination: str, fleet_name: str) -> FleetPage:
    """Make the contents of a fleet's page."""
    rows, cycles = results.selected_results, results.scan_rows_of_selected_results("cycles")
    days = summarise_results_by_day(rows, cycles)
    calibrations = results.calibrations_in_use
    last = days["day"].max()
    return FleetPage(
        name=fleet_name,
        results=rows,
        days=days,
        weeks=sum_weekly_tonnes(rows),
        charts=make_machine_charts(days),
        calibrations=calibrations,
        changes=find_line_changes(calibrations),
        recordings_by_concern=add_column_of_open_commands(
            rank_recordings_by_concern(
                rows, cycles, results.scan_rows_of_selected_results("findings")
            ),
            destination,
        ),
        failed=results.failure_reason_by_source,
        today=last if isinstance(last, dt.date) else None,
    )


def add_column_of_open_commands(recordings: pl.DataFrame, destination: str) -> pl.DataFrame:
    """Add a column with the command that opens each recording at the time of interest."""
    where = shlex.quote(destination)
    commands = [
        f"payscope fleet open {where} {key[: LIMITS.shown_key_digits]} --at {max(at, 0.0):.1f}"
        for key, at in recordings.select("key", "at_s").iter_rows()
    ]
    return recordings.with_columns(pl.Series("command", commands, dtype=pl.String))


def _convert_drift_to_dict(drift_chart: MachineChart) -> dict[str, Any]:
    """Convert the flagged change of a control chart to JSON-compatible values."""
    found = drift_chart.chart
    assert found.flagged_index is not None
    assert found.first_shifted_index is not None
    return {
        "machine": drift_chart.machine,
        "of": drift_chart.signal.name,
        "change": drift_chart.flagged_change_in_unit,
        "change_std": drift_chart.flagged_change_std_in_unit,
        "unit": drift_chart.signal.unit,
        "since": str(drift_chart.days[found.first_shifted_index]),
        "flagged": str(drift_chart.days[found.flagged_index]),
    }


def estimate_fleet_friction_trends(
    results: pl.DataFrame, limit_N_s_m: float
) -> dict[str, FrictionTrend]:
    """Estimate by the joint fits of recordings when each machine's friction reaches a limit.

    Args:
        results: table `results`.
        limit_N_s_m: upper limit of viscous friction.
    """
    known = results.filter(
        pl.col("day") != UNDATED, pl.col("friction_x_N_s_m").is_not_null()
    ).filter(pl.col("friction_x_std_N_s_m") > 0.0)
    days: dict[str, list[FrictionDay]] = {
        machine: [] for machine in sorted(results["machine"].unique())
    }
    columns = ("machine", "t0_unix_ns", "friction_x_N_s_m", "friction_x_std_N_s_m")
    for machine, start_ns, friction, std in known.select(columns).iter_rows():
        days[machine].append(FrictionDay(start_ns / _DAY_NS, friction, std))
    return {machine: fit_daily_friction_trend(each, limit_N_s_m) for machine, each in days.items()}
