"""Whether a log can weigh at all: a good log passes, each broken one fails its check."""

import numpy as np
import polars as pl
import pytest

from analysis.diagnosis import CheckInputs, judge_log_by_checks
from analysis.diagnosis.fit_checks import FIT_CHECKS
from analysis.diagnosis.signal_checks import SIGNAL_CHECKS
from analysis.model.schema import build_frame
from analysis.model.verdict import Verdict
from analysis.stages.gating.gate import gate_windows
from analysis.stages.motion.phases import compute_trailing_speed_rate

TRIP = ("standstill", "start", "brake", "standstill")


@pytest.fixture(scope="module")
def good(drive):
    return drive(TRIP * 3, (1.5, 5.0, 2.0, 1.5) * 3)


@pytest.fixture
def judge(excitation_of, machine):
    def judged(made, machine=machine()):  # noqa: B008 - frozen, and the plain machine
        excitation = excitation_of(made, machine)
        return judge_log_by_checks(
            CheckInputs(excitation, gate_windows(excitation, machine.settings), machine)
        )

    return judged


def check(table, name):
    return table.row(by_predicate=pl.col("check") == name, named=True)


def failed(table):
    return set(table.filter(pl.col("passed").not_())["check"])


def test_a_good_log_passes_every_check_with_its_number(good, judge):
    table = judge(good)
    assert Verdict.from_frame(table).can_weigh
    assert table["passed"].all()
    # of frames alone: neither the fit nor the raw signals are at hand
    others = {row.name for row in (*FIT_CHECKS, *SIGNAL_CHECKS)} - {"imu_tilt_deg"}
    others |= {"negative_payload", "empty_mass"}
    assert set(table.filter(pl.col("passed").is_null())["check"]) == others
    assert table.filter(pl.col("passed").is_not_null())["value"].null_count() == 0
    assert check(table, "partial_correlation")["value"] > 0.9
    assert check(table, "relative_std")["value"] < 0.05
    assert check(table, "r_squared")["value"] > 0.95
    assert check(table, "opposing_share")["value"] > 0.8
    assert check(table, "acceleration_gain")["value"] == pytest.approx(1.0, abs=0.1)
    assert check(table, "accepted_stretches")["value"] == 3.0
    assert check(table, "empty_mass_ratio")["value"] == pytest.approx(1.0, abs=0.05)
    assert all(table["meaning"])


def test_a_force_that_has_lost_its_sign_is_found(good, judge):
    table = judge(good.but(force_x_N=np.abs))
    assert not Verdict.from_frame(table).can_weigh
    assert failed(table) == {"opposing_share"}
    # the noise about zero aside
    assert check(table, "opposing_share")["value"] < 0.05


@pytest.mark.parametrize("left_N", [150.0, -20.0])
def test_brakes_that_no_sensor_sees_are_no_force_that_has_lost_its_sign(good, judge, left_N):
    """An offset, or what rolls, is all that is left of the force while they act."""

    def without_brakes(force):
        return np.where(force * good.speed_x_m_s < 0.0, left_N * np.sign(good.speed_x_m_s), force)

    table = judge(good.but(force_x_N=without_brakes))
    assert Verdict.from_frame(table).can_weigh
    assert check(table, "opposing_share")["value"] is None
    assert check(table, "opposing_share")["passed"] is None


def test_an_accelerometer_that_sees_a_tenth_of_the_motion_is_found(good, judge):
    table = judge(good.but(specific_force_x_m_s2=lambda x: 0.1 * x))
    assert not Verdict.from_frame(table).can_weigh
    assert check(table, "acceleration_gain")["value"] == pytest.approx(0.1, abs=0.02)
    assert {"acceleration_gain", "empty_mass_ratio"} <= failed(table)


def test_a_force_that_has_nothing_to_do_with_the_motion_is_found(good, judge):
    noise = np.random.default_rng(3).normal(0, 3000, good.force_x_N.size)
    table = judge(good.but(force_x_N=noise))
    assert not Verdict.from_frame(table).can_weigh
    assert {"partial_correlation", "relative_std", "r_squared"} <= failed(table)


def test_a_log_without_motion_cannot_weigh(drive, judge):
    table = judge(drive(("standstill",), (20.0,)))
    assert not Verdict.from_frame(table).can_weigh
    assert {"partial_correlation", "relative_std", "r_squared", "accepted_stretches"} <= failed(
        table
    )
    assert check(table, "accepted_stretches")["value"] == 0.0
    assert check(table, "partial_correlation")["value"] is None
    assert check(table, "opposing_share")["passed"] is None


def test_a_mass_that_the_machine_cannot_have_is_found(good, judge, machine):
    table = judge(good, machine(body={"empty_mass_kg": 300.0}))
    assert failed(table) == {"empty_mass_ratio"}
    assert check(table, "empty_mass_ratio")["value"] == pytest.approx(12, rel=0.05)


def test_checks_that_do_not_apply_are_null_and_do_not_fail(drive, judge, machine):
    never_brakes = drive(("standstill", "start"), (1.5, 5.0))
    table = judge(never_brakes, machine(body={"empty_mass_kg": None}))
    assert check(table, "opposing_share")["passed"] is None
    assert check(table, "empty_mass_ratio")["passed"] is None
    assert Verdict.from_frame(table).can_weigh


def test_the_limits_are_settings(good, judge, machine):
    strict = machine({"verdict": {"accepted_stretches_min": 4, "relative_std_max": 1e-6}})
    table = judge(good, strict)
    assert failed(table) == {"accepted_stretches", "relative_std"}
    assert check(table, "accepted_stretches")["minimum"] == 4.0
    assert check(table, "relative_std")["maximum"] == 1e-6


def test_the_gate_does_not_shield_a_bad_log_from_the_verdict(good, judge):
    """Windows that look fine are there, and the log still fails."""
    table = judge(good.but(force_x_N=np.abs))
    assert check(table, "accepted_stretches")["value"] >= 1
    assert not Verdict.from_frame(table).can_weigh


def test_fast_motion_does_not_make_wheels_and_accelerometer_disagree(machine):
    """The speed rate looks back a tenth of a second: the accelerometer is delayed alike."""
    t = np.arange(3000) / 100.0
    settings = machine().settings
    speed = 2.0 + 0.2 * np.sin(2 * np.pi * 2.0 * t)
    acc = 0.2 * 2 * np.pi * 2.0 * np.cos(2 * np.pi * 2.0 * t)
    rate = compute_trailing_speed_rate(speed, settings)
    excitation = build_frame(
        "excitation",
        {
            "t_ns": np.arange(t.size) * 10_000_000,
            "force_x_N": 3614.0 * acc + 2891.0 * speed,
            "regressor_acc_x_m_s2": acc,
            "speed_x_m_s": speed,
            "speed_rate_x_m_s2": rate,
            "specific_force_x_m_s2": acc,
            "phase": pl.Series(np.where(rate > 0, "accelerating", "braking")),
        },
    )
    table = judge_log_by_checks(
        CheckInputs(excitation, gate_windows(excitation, settings), machine())
    )
    assert check(table, "acceleration_gain")["value"] == pytest.approx(1.0, abs=0.05)
