"""Print lines of reports of `follow`, and show a panel with state, gate, estimates and loads."""

import json
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Final, Self

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from analysis.model.methods import METHODS
from analysis.online.follower import FollowedRow
from analysis.online.online_report import OnlineReport
from analysis.online.replay_report import ReplayReport
from estimators.errors import format_count
from replay.commands.screen_limits import LIMITS
from replay.follow.background_replay import BackgroundReplays
from replay.follow.follow_logs import FollowedLogState
from replay.follow.followed_outputs import FollowedOutputs
from replay.follow.report_file import (
    describe_finished_manoeuvre,
    describe_inertia_and_yaw_friction,
    describe_load_state,
    describe_mass_and_friction,
    describe_progress_to_target_uncertainty,
    describe_replay_result,
    format_utc_time_of_day,
    iter_closed_load_lines,
)

_GATE_COLOURS: Final = {"accepted": "green", "warming_up": "dim", "gap": "red"}


class FollowPanel:
    """Panel of a followed log on stderr, shown only on a terminal."""

    def __init__(self) -> None:
        self._live: Live | None = None
        if sys.stderr.isatty():
            self._live = Live(
                console=Console(stderr=True),
                refresh_per_second=LIMITS.drawn_hz,
                # lines of data are printed above the panel, unless stdout is a pipe
                redirect_stdout=sys.stdout.isatty(),
            )
        self._masses: deque[OnlineReport] = deque(maxlen=LIMITS.followed_manoeuvres)
        self._last: OnlineReport | None = None
        self._replay: ReplayReport | None = None
        self._next_draw_s = 0.0

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show_waiting_for_replay(self) -> None:
        """Show that the command waits for the replay of the whole log, if there is a panel."""
        if self._live is not None:
            self._live.console.print("replays the whole log; ctrl-C leaves that out")

    def show_replay_result(self, report: ReplayReport) -> None:
        """Show the result of a replay from now on; a failure only if there is no result yet."""
        if not report.fault or self._replay is None or self._replay.fault:
            self._replay = report

    def show_followed_log(self, following: FollowedLogState, reports: list[OnlineReport]) -> None:
        """Show the state of a followed log: as often as the panel is drawn, and at the end."""
        for report in reports:
            self._last = report
            if report.event == "manoeuvre":
                self._masses.append(report)
        now_s = time.monotonic()
        if self._live is not None and (now_s >= self._next_draw_s or following.end_reason):
            self._next_draw_s = now_s + 1.0 / LIMITS.drawn_hz
            self._live.update(Group(*self._render_panel_parts(following)))

    def _render_panel_parts(self, following: FollowedLogState) -> list[Text | Table]:
        parts: list[Text | Table] = [self._render_panel_head(following)]
        if self._last is None:
            waits = following.topics_without_messages or following.follower.topics
            parts.append(Text(f"waits for {', '.join(waits)}", style="yellow"))
            if following.topics and following.missing_topics_remedy:
                parts.append(Text(following.missing_topics_remedy.removeprefix("; "), style="dim"))
            return parts
        parts += [_format_machine_motion(self._last), _format_current_answer(self._last)]
        if progress := describe_progress_to_target_uncertainty(self._last):
            parts.append(Text(f"online, statistical u: {progress}"))
        if spun := describe_inertia_and_yaw_friction(self._last):
            parts.append(Text(spun))
        parts.append(_make_method_table(following))
        if self._masses:
            parts.append(_make_manoeuvre_table(list(self._masses)))
        if self._replay is not None:
            parts += _format_replayed_loads(self._replay.copy_with_age_at(self._last.unix_ns))
        if following.losses:
            count = "1 loss" if len(following.losses) == 1 else f"{len(following.losses):,} losses"
            parts.append(Text(f"{count}: {following.losses[-1]}"))
        if late := following.follower.log.late_samples:
            samples = format_count(late, "sample")
            parts.append(Text(f"{samples} arrived too late for the row", style="yellow"))
        return parts

    def _render_panel_head(self, following: FollowedLogState) -> Text:
        names = ", ".join(path.name for path in following.paths)
        rows = following.follower.rows_stepped
        state = following.end_reason or "ctrl-C ends"
        return Text(
            f"{names}  {rows:,} rows, last poll {1e3 * following.last_poll_s:.0f} ms  ({state})",
            style="bold",
        )


class ReportPrinter:
    """Printer of the reports of rows and replays, each once it is on disk."""

    def __init__(
        self,
        outputs: FollowedOutputs,
        panel: FollowPanel,
        replays: BackgroundReplays,
        *,
        as_json: bool,
    ) -> None:
        """Initialise; nothing is printed yet.

        Args:
            outputs: files to which a report is written before it is printed.
            panel: the panel.
            replays: background replays, requested at the end of each manoeuvre and spin.
            as_json: whether to print lines of JSON.
        """
        self._outputs, self._panel, self._replays = outputs, panel, replays
        self._as_json = as_json
        self._newest: OnlineReport | None = None
        self._replay: ReplayReport | None = None

    def print_row_reports(self, following: FollowedLogState, rows: list[FollowedRow]) -> None:
        """Write and print the reports of new rows, and of a replay that has finished."""
        made = self._outputs.write_rows_and_return_new_reports(following, rows)
        for report in (report for row in rows for report in row.reports):
            self._newest = report
            if report.event in ("manoeuvre", "spin"):
                self._replays.request_replay_of_log_so_far()
        for report in made:
            if self._as_json:
                typer.echo(json.dumps(report.to_dict(), allow_nan=False))
            elif text := describe_finished_manoeuvre(report):
                typer.echo(f"{format_utc_time_of_day(report.unix_ns)}  {text}")
        self.print_replay_result(self._replays.take_result_and_start_next())
        self._panel.show_followed_log(following, made)

    def wait_for_last_replay_and_print_it(
        self, following: FollowedLogState, is_wait_cancelled: Callable[[], bool]
    ) -> None:
        """Wait for the replay of the whole log and print its result, unless cancelled."""
        self.print_replay_result(
            self._replays.wait_for_replay_of_whole_log(
                self._panel.show_waiting_for_replay,
                is_wait_cancelled,
                is_growing=following.is_interrupted,
            )
        )

    def print_replay_result(self, replay_report: ReplayReport | None) -> None:
        """Write and print the result of a replay."""
        newest = self._newest
        if replay_report is None or newest is None:
            return
        if replay_report.fault:
            replay_report = replace(replay_report, unix_ns=newest.unix_ns, t_s=newest.t_s)
        replay_report = replay_report.copy_with_age_at(newest.unix_ns)
        self._panel.show_replay_result(replay_report)
        if not self._outputs.write_replay_report_if_new(replay_report, newest.unix_ns):
            return
        if self._as_json:
            typer.echo(json.dumps(replay_report.to_dict(), allow_nan=False))
        else:
            for line in iter_closed_load_lines(replay_report, self._replay):
                typer.echo(line)
        if not replay_report.fault:
            self._replay = replay_report


def _format_machine_motion(online_report: OnlineReport) -> Text:
    text = Text(
        f"{format_utc_time_of_day(online_report.unix_ns)} UTC, {online_report.t_s:,.1f} s  "
        f"{online_report.phase or 'unknown'}  gate "
    )
    text.append(online_report.gate, style=_GATE_COLOURS.get(online_report.gate, "yellow"))
    if online_report.index_nat is not None:
        text.append(f" ({online_report.index_nat:.2f} nat)")
    return text


def _format_current_answer(online_report: OnlineReport) -> Text:
    age = "" if online_report.age_s is None else f", {online_report.age_s:,.0f} s old"
    return Text(
        f"{describe_mass_and_friction(online_report)}{age}",
        style="bold green" if online_report.mass_kg else "yellow",
    )


def _make_method_table(following: FollowedLogState) -> Table:
    table = Table("method", "mass, kg", "u", "friction, N·s/m", "u", box=None)
    for name, (_, estimate) in following.follower.newest.items():
        theta, std = estimate.theta, estimate.std
        cells = (theta[0], std[0], theta[1], std[1])
        table.add_row(METHODS[name].title, *(f"{value:,.1f}" for value in cells))
    for column in table.columns[1:]:
        column.justify = "right"
    return table


def _make_manoeuvre_table(reports: list[OnlineReport]) -> Table:
    table = Table("manoeuvre", "until", "mass", box=None)
    for report in reports:
        table.add_row(
            str(report.manoeuvres),
            format_utc_time_of_day(report.unix_ns),
            describe_mass_and_friction(report),
        )
    return table


def _format_replayed_loads(replay_report: ReplayReport) -> list[Text]:
    """Format the result and the last load states of a replay."""
    style = "bold green" if replay_report.validity == "valid" else "yellow"
    return [
        Text(f"joint fit, u of all effects: {describe_replay_result(replay_report)}", style=style),
        *map(Text, map(describe_load_state, replay_report.loads[-LIMITS.followed_manoeuvres :])),
    ]
