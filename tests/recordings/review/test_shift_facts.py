"""The sentences of a review: holes, torn logs, and numbers whose ± says nothing."""

from typing import Any

import polars as pl
import pytest

from recordings.review.review_state import ReviewState
from recordings.review.shift_facts import (
    describe_long_gaps,
    describe_truncated_logs,
    explain_why_no_cycle_is_counted,
    list_mean_phase_durations,
    list_shift_names_and_values,
    summarise_shift_in_line,
)
from recordings.review.shift_ledger import add_motion_columns, make_ledger_frame
from recordings.review.truncated_logs import TruncatedLog
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found, summed

FRAMES = drawn_shift([700.0, 650.0, 720.0, 680.0])


def state(**more: Any) -> ReviewState:
    plain = dict.fromkeys(("inputs", "failed", "losses", "notes", "gaps_s", "sampling"), ())
    return ReviewState.model_validate(
        {
            **plain,
            **dict.fromkeys(("key", "recording_sha256", "machine", "begins"), ""),
            "resolved": {},
            "gate_shares": {},
            "t0_unix_ns": 1_700_000_000 * 10**9,
            "can_weigh": True,
            "friction": (None, None),
            "digs": 4,
            "duration_s": 8000.0,
            "timezone": "Europe/Berlin",
            **more,
        }
    )


def rows(of: ReviewState) -> pl.DataFrame:
    return add_motion_columns(make_ledger_frame(found(FRAMES), of.t0_unix_ns, {}), of)


def torn(next_s: float | None) -> TruncatedLog:
    return TruncatedLog(
        name="b.mcap", number=2, logs=3, ends_s=3600.0, next_s=next_s, losses=("in bytes",)
    )


def test_cycles_that_differ_in_a_number_alone_have_one_reason() -> None:
    shift = state()
    reasons = ["± 286 kg is more than 250 kg", "± 314.5 kg is more than 250 kg", "not dumped yet"]
    ledger = rows(shift)[:3].with_columns(
        counted=pl.lit(value=False), withheld_for=pl.Series(reasons)
    )
    assert explain_why_no_cycle_is_counted(shift, ledger) == (
        "2 cycles, such as: ± 286 kg is more than 250 kg; 1 cycle: not dumped yet"
    )


def test_a_torn_log_in_the_middle_says_how_many_minutes_are_missing() -> None:
    [sentence] = describe_truncated_logs(state(torn=(torn(3840.0),)))
    assert sentence.startswith("Log 2 of 3 (b.mcap) breaks off at 2023-11-15 00:13:20 +01:00")
    assert "at most 4 min are missing" in sentence
    assert "byte" not in sentence


def test_what_a_torn_last_log_hides_is_unknown_in_headline_and_facts() -> None:
    shift = summed(FRAMES)
    last = state(torn=(torn(None),))
    assert summarise_shift_in_line(shift, "", last).endswith(
        "until 2023-11-15 00:13:20 +01:00, the rest of the shift is unknown"
    )
    lost = dict(list_shift_names_and_values(shift, rows(last), last, None))[
        "estimated where nothing was recorded"
    ]
    assert lost == "unknown after 2023-11-15 00:13:20 +01:00"
    whole = dict(list_shift_names_and_values(shift, rows(state()), state(), None))
    assert whole["estimated where nothing was recorded"] == "nothing"


@pytest.mark.parametrize(
    ("least_kg", "said"), [(4922.1, "loads below about 4,900 kg count as empty"), (None, None)]
)
def test_the_smallest_load_that_shows_is_a_fact_where_a_recording_has_it(
    least_kg: float | None, said: str | None
) -> None:
    shift = summed(FRAMES) | {"min_detectable_kg": least_kg}
    assert (
        dict(list_shift_names_and_values(shift, rows(state()), state(), None)).get("sensitivity")
        == said
    )


def test_a_hole_of_half_an_hour_is_said_on_top_with_what_it_costs() -> None:
    shift = summed(FRAMES) | {
        "lost_cycles": 14.5, "lost_cycles_u": 0.7, "lost_kg": 9700.0, "lost_u_kg": 700.0,
    }  # fmt: skip
    said = describe_long_gaps(shift, state(gaps_s=((600.0, 2400.0), (3000.0, 3020.0))))
    assert said.startswith("Readings are missing from 2023-11-14 23:23:20 +01:00")
    assert "(30 min)" in said
    assert "14.5 ± 1.4 loads, 9.70 ± 1.40 t" in said
    assert "20 s" not in said
    assert not describe_long_gaps(shift, state())


def test_a_cycle_with_a_hole_is_in_no_mean() -> None:
    table = rows(state()).with_columns(
        return_s=pl.Series([40.0, 1840.0, 40.0, 40.0]),
        load_s=5.0,
        haul_s=30.0,
        dump_s=10.0,
        hole_s=pl.Series([0.0, 1800.0, 0.2, 0.0]),
    )
    [(_, text)] = list_mean_phase_durations(table)
    assert text.startswith("85 s on average over 3 whole cycles: ")


@pytest.mark.parametrize(("mean_kg", "shown"), [(22.0, False), (90.0, True), (-90.0, True)])
def test_a_mean_carried_back_is_said_only_where_its_interval_leaves_zero_out(
    mean_kg: float, shown: bool
) -> None:
    shift = summed(FRAMES) | {"carry_back_mean_kg": mean_kg, "carry_back_u_kg": 30.5}
    assert (
        "carried back" in dict(list_shift_names_and_values(shift, rows(state()), state(), None))
    ) is shown


def test_every_cycle_is_counted_or_said_why_not() -> None:
    ledger = rows(state()).with_columns(
        counted=pl.Series([True, False, False, False]),
        rejected=pl.Series([False, True, False, False]),
        quality=pl.Series(["good", "good", "no mass", "not dumped"]),
        payload_kg=pl.Series([700.0, None, None, 680.0]),
    )
    said = dict(list_shift_names_and_values(summed(FRAMES), ledger, state(), None))["cycles"]
    assert said.startswith("4 detected (")
    assert said.endswith("), 1 counted, 1 rejected, 1 without a mass, 1 still on board at the end")


def test_tonnes_and_cycles_an_hour_leave_out_what_was_not_recorded() -> None:
    shift = summed(FRAMES) | {"duration_s": 7200.0, "gap_s": 3600.0, "payload_kg": 2750.0}
    said = dict(list_shift_names_and_values(shift, rows(state()), state(), None))["per hour"]
    assert said.startswith("2.75")
    assert "4.0 cycles" in said


def test_a_state_with_former_names_of_checks_has_the_present_ones() -> None:
    failed = dict.fromkeys(("limit", "meaning", "remedy"), "") | {"value": 1.0}
    read = state(
        failed=[{**failed, "check": "direction", "consequence": "tell"}],
        findings=["unknown cause: no known cause explains the failed checks: lag 1 > 0.1: late"],
        no_cycle="lag, r_squared",
    )
    assert [each.check for each in read.failed] == ["coulomb_friction"]
    assert ": force_delay_s 1 > 0.1: late" in read.findings[0]
    assert read.no_cycle == "force_delay_s, r_squared"
    again = ReviewState.model_validate_json(read.model_dump_json())
    assert again == read
