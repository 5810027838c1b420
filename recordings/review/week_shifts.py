"""Reviewed shifts of a week: missing data, and trends of friction."""

import datetime as dt
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from analysis.cycles.friction_trend import FrictionDay, FrictionTrend, fit_friction_trend
from analysis.model.physical_units import NS
from recordings.report.shift_text import K
from recordings.review.review_state import ReviewState, read_review_state
from recordings.review.shift_facts import (
    long_gap_spans_text,
    loss_texts_besides_torn_ends,
    torn_log_sentences,
    two_machines_warning,
)
from recordings.review.week_totals import machine_title

#: Seconds of a day.
_DAY_S: Final = 86_400.0


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
    """Shifts in the folders that `read_week` accepts, in order of time."""
    states = [
        (folder, state) for folder in folders if (state := read_review_state(folder)) is not None
    ]
    states.sort(key=lambda pair: pair[1].t0_unix_ns)
    return [
        WeekShift(
            folder,
            state.begins,
            machine_title(state),
            tuple(_list_missing_parts(state)),
            _friction_of_state(state),
        )
        for folder, state in states
    ]


def _list_missing_parts(state: ReviewState) -> Iterable[str]:
    if state.mixed_machines:
        yield two_machines_warning(state)
    if gaps := long_gap_spans_text(state):
        yield f"Nothing was recorded {gaps}."
    yield from torn_log_sentences(state)
    yield from loss_texts_besides_torn_ends(state)


def _friction_of_state(state: ReviewState) -> FrictionDay | None:
    value, std = state.friction
    if value is None or not std or not state.clock.is_dated:
        return None
    middle_s = state.t0_unix_ns / NS + state.duration_s / 2.0
    return FrictionDay(middle_s / _DAY_S, value, std)


def friction_by_machine(shifts: Sequence[WeekShift]) -> dict[str, list[FrictionDay]]:
    """Friction of each machine's shifts, in order of time."""
    found: dict[str, list[FrictionDay]] = defaultdict(list)
    for shift in shifts:
        if shift.friction is not None:
            found[shift.machine].append(shift.friction)
    return dict(found)


def friction_trend_by_machine(
    shifts: Sequence[WeekShift], limit_N_s_m: float
) -> dict[str, FrictionTrend]:
    """Trend of friction by machine, and when it reaches the limit."""
    by_machine = {shift.machine: list[FrictionDay]() for shift in shifts} | friction_by_machine(
        shifts
    )
    return {
        machine: fit_friction_trend(days, limit_N_s_m)
        for machine, days in sorted(by_machine.items())
    }


def day_text(at_d: float) -> str:
    """Date of a day number on the week's clock."""
    try:
        return f"{dt.datetime.fromtimestamp(at_d * _DAY_S, dt.UTC):%Y-%m-%d}"
    except (OverflowError, ValueError, OSError):
        return "a day beyond the calendar"


def trend_sentences(trends: Mapping[str, FrictionTrend]) -> list[str]:
    """Sentences on when each machine's friction reaches the limit."""
    return [f"{machine}: {_trend_sentence(trend)}" for machine, trend in trends.items()]


def _trend_sentence(trend: FrictionTrend) -> str:
    limit = f"{trend.limit_N_s_m:,.0f} N·s/m"
    if trend.slope_N_s_m_d is None or trend.slope_u_N_s_m_d is None or trend.now_N_s_m is None:
        return f"when friction reaches {limit} cannot be predicted: {trend.why_not}"
    change = (
        f"{trend.slope_N_s_m_d:+,.1f} ± {K * trend.slope_u_N_s_m_d:,.1f} N·s/m a day, "
        f"{trend.now_N_s_m:,.0f} N·s/m at the last shift"
    )
    if trend.reached_d is None:
        return f"friction {change}; when it reaches {limit} cannot be predicted: {trend.why_not}"
    first, last = map(day_text, trend.reached_d)
    return f"friction {change}; it reaches {limit} between {first} and {last} (95 %)"
