"""Frames of a fleet: days, weeks, comparisons, what needs a look, lines of calibrations."""

import datetime as dt
from typing import Any

import polars as pl
import pytest

from analysis.fleet.calibration_steps import FleetCalibration, find_line_changes
from analysis.fleet.daily_figures import (
    rank_recordings_by_concern,
    sum_daily_results_over_machines,
    sum_tonnes_by_group,
    sum_weekly_tonnes,
    summarise_results_by_day,
)
from analysis.fleet.fleet_tables import TABLES, convert_frame_to_table_rows, make_table_schema
from analysis.fleet.results_comparison import compare_fleet_results

OF = {"key": "k", "machine": "m", "day": "2026-01-05", "t0_unix_ns": 1}


def results(*rows: dict[str, Any]) -> pl.DataFrame:
    plain = {
        "status": "replayed",
        "reason": "",
        "can_weigh": True,
        "failed_checks": "",
        "losses": 0,
        "first_loss": "",
        "not_calibrated_for": "",
        "lost_cycles": 0.0,
        "cycles": 10,
        "cycles_counted": 10,
        "cycles_without_mass": 0,
        "accepted_1": 0.3,
        "payload_kg": 7000.0,
        "payload_u_random_kg": 30.0,
        "payload_u_common_kg": 40.0,
        "duration_s": 3600.0,
        "calibration": "",
        "source": "s",
        "log_sha256": "x",
    }
    frames = [
        convert_frame_to_table_rows(
            "results", pl.DataFrame([{**plain, **row}]), {**OF, "key": f"k{n}", **_of(row)}
        )
        for n, row in enumerate(rows)
    ]
    return pl.concat(frames)


def _of(row: dict[str, Any]) -> dict[str, Any]:
    return {name: row[name] for name in OF if name in row}


def cycles(*rows: dict[str, Any]) -> pl.LazyFrame:
    schema = make_table_schema("cycles")
    frames = [
        convert_frame_to_table_rows(
            "cycles", pl.DataFrame([{"counted": True, **row}]), {**OF, **_of(row)}
        )
        for row in rows
    ]
    return pl.concat([pl.DataFrame(schema=schema), *frames]).lazy()


def findings(*rows: dict[str, Any]) -> pl.LazyFrame:
    schema = make_table_schema("findings")
    frames = [
        convert_frame_to_table_rows("findings", pl.DataFrame([row]), {**OF, **_of(row)})
        for row in rows
    ]
    return pl.concat([pl.DataFrame(schema=schema), *frames]).lazy()


def test_the_first_cause_of_a_recording_is_a_reason_unless_it_only_tells() -> None:
    found = rank_recordings_by_concern(
        results({}, {}, {}),
        cycles(),
        findings(
            {"key": "k0", "rank": 1, "cause": "delay", "severity": "widen", "mass_change_kg": 41.7},
            {"key": "k0", "rank": 2, "cause": "slip", "severity": "withhold"},
            {"key": "k1", "rank": 1, "cause": "drift", "severity": "tell"},
            {
                "key": "k2",
                "rank": 1,
                "cause": "frozen",
                "severity": "withhold",
                "start_t_ns": 9 * 10**9,
            },
        ),
    )
    assert found.select("key", "why", "at_s").rows() == [
        ("k2", "likely frozen", 9.0),
        ("k0", "likely delay, which changes the mass by 42 kg", 0.0),
    ]


def test_every_table_begins_with_the_result_that_a_row_is_of() -> None:
    for name in TABLES:
        assert make_table_schema(name).names()[:4] == ["key", "machine", "day", "t0_unix_ns"]
        assert convert_frame_to_table_rows(name, pl.DataFrame(), OF).is_empty()
        assert not any(isinstance(dtype, pl.Enum) for dtype in make_table_schema(name).values())


def test_random_parts_add_up_in_squares_and_common_ones_as_they_are() -> None:
    machines = sum_tonnes_by_group(results({}, {}, {"machine": "n"}), ["machine"])
    m, n = machines.iter_rows(named=True)
    assert m["payload_kg"] == 14_000.0
    assert m["payload_u_random_kg"] == pytest.approx(30.0 * 2**0.5)
    assert m["payload_u_common_kg"] == 80.0
    # what is common to one machine's recordings is not common to two machines
    assert sum_daily_results_over_machines(machines)["payload_u_kg"] == pytest.approx(
        (m["payload_u_kg"] ** 2 + n["payload_u_kg"] ** 2) ** 0.5
    )


def test_weeks_begin_on_mondays_and_undated_recordings_are_in_none() -> None:
    found = sum_weekly_tonnes(
        results({}, {"day": "2026-01-11"}, {"day": "2026-01-12"}, {"day": "undated"})
    )
    assert found["week"].to_list() == [dt.date(2026, 1, 5), dt.date(2026, 1, 12)]
    assert found["recordings"].to_list() == [2, 1]


def test_days_have_means_of_empty_passes_and_counted_payloads() -> None:
    rows = cycles(
        {"empty_after_kg": 3600.0, "payload_kg": 700.0},
        {"empty_after_kg": 3610.0, "payload_kg": 900.0, "counted": False},
        {"empty_after_kg": None, "payload_kg": 720.0},
    )
    (day,) = summarise_results_by_day(results({"friction_x_N_s_m": 2900.0}), rows).iter_rows(
        named=True
    )
    assert (day["zero_kg"], day["load_kg"]) == (3605.0, 710.0)
    assert day["friction_N_s_m"] == 2900.0


def test_what_is_most_wrong_comes_first_with_its_place() -> None:
    rows = results(
        {},
        {"losses": 1, "first_loss": "torn"},
        {"status": "refused", "reason": "no log", "can_weigh": None},
        {"can_weigh": False, "failed_checks": "r_squared"},
        {"lost_cycles": 2.04, "longest_gap_at_s": 812.0},
        {"cycles_without_mass": 4},
    )
    found = rank_recordings_by_concern(
        rows, cycles({"key": "k5", "payload_kg": None, "start_t_ns": 5 * 10**9}), findings()
    )
    assert found.select("key", "at_s").rows() == [
        *(("k2", 0.0), ("k3", 0.0), ("k4", 812.0), ("k5", 5.0), ("k1", 0.0))
    ]
    assert found["why"].to_list() == [
        "refused: no log",
        "cannot weigh: r_squared",
        "about 2.0 cycles in gaps",
        "4 of 10 cycles without a mass",
        "lost: torn",
    ]


def test_a_payload_far_from_the_others_of_its_machine_has_its_cycle_as_place() -> None:
    usual = [{"payload_kg": 700.0 + n % 7, "start_t_ns": n, "cycle": n} for n in range(40)]
    odd = {"key": "k1", "payload_kg": 1400.0, "start_t_ns": 77 * 10**9, "cycle": 9}
    found = rank_recordings_by_concern(results({}, {}), cycles(*usual, odd), findings())
    assert found.rows(named=True)[0]["at_s"] == 77.0
    assert found["why"].to_list() == ["1 payloads far from the others, the farthest 1400 kg"]


def test_a_comparison_is_of_the_logs_that_both_have_the_largest_change_first() -> None:
    a = results({"log_sha256": "1"}, {"log_sha256": "2"}, {"log_sha256": "3"})
    b = results(
        {"log_sha256": "1", "payload_kg": 7100.0},
        {"log_sha256": "2", "payload_kg": 6500.0, "cycles_counted": 9},
        {"log_sha256": "4"},
    )
    found = compare_fleet_results(a, b)
    assert found.logs["change_kg"].to_list() == [-500.0, 100.0]
    assert (found.only_a, found.only_b) == (1, 1)
    assert found.total_change == {
        "logs": 2,
        "changed": 2,
        "payload_kg": 14_000.0,
        "payload_b_kg": 13_600.0,
        "change_kg": -400.0,
        "loads": 20,
        "loads_b": 19,
    }


def line(first: str, c0_kg: float, c1_1: float) -> FleetCalibration:
    day = dt.date.fromisoformat(first)
    about = {"machine": "m", "id": first, "method": "joint_mass", "centre_kg": 3700.0}
    return FleetCalibration(
        first=day, expires=day, c0_kg=c0_kg, c1_1=c1_1, covariance=(4.0, 0.0, 1e-6), **about
    )


def test_lines_that_follow_each_other_are_compared_in_the_middle_of_both() -> None:
    first, same, moved = (
        line("2026-01-01", 0.0, 1.0),
        line("2026-04-01", 1.0, 1.0),
        line("2026-07-01", 30.0, 1.0),
    )
    one, two = find_line_changes([moved, first, same])
    assert (one.offset_change_kg, two.offset_change_kg) == (1.0, 29.0)
    assert one.offset_change_limit_kg == pytest.approx(2.0 * 8.0**0.5)
    assert not one.has_line_moved
    assert two.has_line_moved
