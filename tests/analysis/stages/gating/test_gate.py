"""Which windows are accepted, and the reason for each that is not."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.stages.gating.gate import (
    flag_windows_with_flagged_rows,
    gate_windows,
    mark_samples_for_pooling,
    mark_samples_in_accepted_windows,
)
from tests.analysis.settings_by_name import settings_of

W = 320


def settings(**changes):
    return settings_of(window_samples=W, **changes)


@pytest.fixture(scope="module")
def start(drive, excitation_of):
    """Standstill, a start into a cruise, braking, standstill."""
    return excitation_of(drive())


@pytest.fixture(scope="module")
def long_log(drive, excitation_of):
    """A start, then 8 s of cruise, braking and 6 s of standstill."""
    return excitation_of(
        drive(("standstill", "start", "cruise", "brake", "standstill"), (1.5, 4.0, 8.0, 2.0, 6.0))
    )


def changed(excitation, rows, **columns):
    """The frame with some columns set to a value in some rows."""
    number = pl.int_range(pl.len())
    inside = number.is_between(rows.start, rows.stop - 1)
    return excitation.with_columns(
        pl.when(inside)
        .then(pl.lit(value))
        .otherwise(pl.col(name))
        .cast(excitation[name].dtype)
        .alias(name)
        for name, value in columns.items()
    )


def reasons(excitation, **changes):
    return gate_windows(excitation, settings(**changes))["reason_x"].cast(pl.String).to_numpy()


def test_a_start_from_standstill_is_accepted(start):
    judged = gate_windows(start, settings())
    accepted = judged.filter("accepted_x")
    assert accepted.height > 100
    assert (accepted["reason_x"] == "accepted").all()
    assert (judged["reason_x"] == "accepted").sum() == accepted.height
    assert accepted["mi_x_nat"].min() >= 0.7
    assert accepted["corr_x_1"].min() >= 1 - np.exp(-1.4)


def test_a_window_is_exactly_w_samples(start):
    """The first complete window ends W - 1 rows after the first complete row."""
    judged = gate_windows(start, settings())
    first = start["phase"].is_not_null().arg_max()
    complete = judged["reason_x"] != "warming_up"
    assert complete.arg_max() == first + W - 1
    assert judged["predicted_std_x"].is_not_null().arg_max() == first + W - 1


def test_one_lost_sample_refuses_the_w_windows_that_hold_it_as_a_gap(start):
    at = 500
    lost = reasons(changed(start, range(at, at + 1), force_x_N=None))
    assert (lost[at : at + W] == "gap").all()
    assert lost[at - 1] == reasons(start)[at - 1] == "accepted"
    assert (lost[at + W :] != "gap").all()


def test_a_sample_of_unknown_phase_refuses_its_windows_as_a_gap(start):
    lost = reasons(changed(start, range(500, 501), phase=None))
    assert (lost[500 : 500 + W] == "gap").all()


@pytest.mark.parametrize("phase", ["turning", "arc", "spinning"])
def test_one_turning_sample_refuses_its_windows(start, phase):
    turned = reasons(changed(start, range(500, 501), phase=phase))
    assert (turned[500 : 500 + W] == "turning").all()
    assert turned[499] == "accepted"


@pytest.mark.parametrize("at", [0, 150, W - 1])
def test_braking_anywhere_in_the_window_refuses_it(start, at):
    end = 550
    assert reasons(start)[end] == "accepted"
    braked = changed(start, range(end - at, end - at + 1), phase="braking")
    assert reasons(braked)[end] == "braking"


def test_braking_is_welcome_when_it_is_not_excluded(start):
    braking = (start["phase"] == "braking").fill_null(False).arg_max()
    assert reasons(start)[braking + 50] == "braking"
    assert reasons(start, exclude_braking=False)[braking + 50] == "accepted"


def test_standstill_is_the_reason_only_when_every_sample_stands(long_log):
    why = reasons(long_log)
    standing = (long_log["phase"] == "standstill").fill_null(False).to_numpy()
    for end in np.flatnonzero(why == "standstill"):
        assert standing[end - W + 1 : end + 1].all()
    assert (why == "standstill").sum() > 100


def test_constant_speed_is_refused_for_little_information_or_negative_dependence(long_log):
    why = reasons(long_log)
    cruise = slice(150 + 400 + 2 * W, 150 + 400 + 800 - 10)
    assert set(why[cruise]) <= {"low_information", "negative_dependence"}


def test_a_window_without_any_variance_gives_no_number_but_a_reason(start):
    n = start.height
    constant = changed(
        start,
        range(n),
        force_x_N=5782.0,
        regressor_acc_x_m_s2=0.1,
        speed_x_m_s=2.0,
        phase="cruising",
    )
    judged = gate_windows(constant, settings())[W + 20 :]
    assert (judged["reason_x"] == "no_variance").all()
    assert judged["mi_x_nat"].null_count() == judged["corr_x_1"].null_count() == judged.height


def test_force_against_acceleration_is_negative_dependence(start):
    upside_down = start.with_columns(-pl.col("force_x_N"))
    judged = gate_windows(upside_down, settings())
    complete = judged.filter(pl.col("predicted_std_x").is_not_null())
    assert "negative_dependence" in complete["reason_x"].to_list()
    assert not complete["accepted_x"].any()
    negative = complete.filter(pl.col("reason_x") == "negative_dependence")
    assert (negative["mi_x_nat"] < 0).all()


def test_a_force_at_the_sensors_end_is_saturated(start):
    assert "saturated" not in reasons(start)
    why = reasons(changed(start, range(500, 501), force_x_N=-9000.0), saturation_force_N=9000.0)
    assert (why[500 : 500 + W] == "saturated").all()
    assert why[499] == "accepted"


@pytest.mark.parametrize("clip_N", [3000.1, 2999.7, 4321.123, 5000.3])
def test_a_mean_of_clipped_samples_is_saturated_whatever_its_rounding(drive, excitation_of, clip_N):
    clipped = drive(noise=0.0).but(force_x_N=lambda f: np.minimum(f, clip_N))
    judged = gate_windows(excitation_of(clipped), settings(saturation_force_N=clip_N))
    assert "saturated" in judged["reason_x"].to_list()


@pytest.mark.parametrize("pitch_deg", [0.0, 5.0, -5.0])
def test_a_hard_start_on_a_slope_of_known_pitch_does_not_slip(drive, excitation_of, pitch_deg):
    """The speed rate looks back over its span, the accelerometer does not, and feels gravity."""
    pitch = np.deg2rad(pitch_deg)
    hard = ("standstill", "start", "cruise", "brake", "standstill"), (1.5, 1.0, 3.0, 2.0, 1.5)
    pushed = drive(*hard, pitch_rad=pitch, throttle_N=9000.0)
    excitation = excitation_of(pushed).with_columns(pitch_rad=pl.lit(float(pitch)))
    why = reasons(excitation, slip_acc_m_s2=0.6)
    np.testing.assert_array_equal(why == "accepted", reasons(excitation) == "accepted")
    assert "accepted" in why


def test_without_an_accelerometer_nothing_slips(start):
    blind = start.drop("specific_force_x_m_s2")
    assert "slip" not in reasons(blind, slip_acc_m_s2=0.01)


def test_wheels_that_speed_up_without_the_machine_slip(start):
    assert "slip" not in reasons(start)
    why = reasons(changed(start, range(500, 501), speed_rate_x_m_s2=5.0), slip_acc_m_s2=2.0)
    assert (why[500:550] == "slip").all()
    assert why[499] == "accepted"


def test_columns_that_are_nearly_one_are_ill_conditioned(start):
    nearly = start.with_columns(speed_x_m_s=pl.col("regressor_acc_x_m_s2") * 2.0)
    why = reasons(nearly)
    assert "ill_conditioned" in why
    assert "accepted" not in why


def test_the_threshold_decides(start):
    index = gate_windows(start, settings())["mi_x_nat"].to_numpy()
    for threshold in (0.3, 0.7, 1.2):
        judged = gate_windows(start, settings(threshold_nat=threshold))
        accepted = judged["accepted_x"].to_numpy()
        assert (index[accepted] >= threshold).all()
        low = (judged["reason_x"] == "low_information").fill_null(False).to_numpy()
        assert (index[low] < threshold).all()
    assert not gate_windows(start, settings(threshold_nat=50.0))["accepted_x"].any()


def test_a_log_shorter_than_a_window_only_warms_up(start):
    assert set(reasons(start[: W - 1])) == {"warming_up"}
    assert gate_windows(start[:0], settings()).height == 0


flags = st.lists(st.booleans(), max_size=60).map(lambda x: np.array(x, bool))


@given(flags, st.integers(1, 70))
def test_windows_with_looks_at_exactly_the_window(flag, window):
    expected = [flag[max(0, k + 1 - window) : k + 1].any() for k in range(flag.size)]
    np.testing.assert_array_equal(flag_windows_with_flagged_rows(flag, window), expected)


@given(flags, st.integers(1, 70))
def test_an_accepted_sample_lies_in_at_least_one_accepted_window(accepted, window):
    inside = np.zeros(accepted.size, bool)
    for k in np.flatnonzero(accepted):
        inside[max(0, k - window + 1) : k + 1] = True
    np.testing.assert_array_equal(mark_samples_in_accepted_windows(accepted, window), inside)


def test_pooled_samples_neither_stand_still_nor_are_about_to_brake(start):
    judged = gate_windows(start, settings())
    used = mark_samples_for_pooling(start, judged, settings())
    inside = mark_samples_in_accepted_windows(judged["accepted_x"].to_numpy(), W)
    standing = (start["phase"] == "standstill").fill_null(False).to_numpy()
    # the phase sees braking late by up to its span (10 rows) and the moving mean (10 rows)
    braking = np.flatnonzero((start["phase"] == "braking").fill_null(False).to_numpy())
    about_to_brake = np.zeros(start.height, np.bool_)
    for k in braking:
        about_to_brake[max(k - 19, 0) : k + 1] = True
    assert (about_to_brake & inside & ~standing).any()
    np.testing.assert_array_equal(used, inside & ~standing & ~about_to_brake)
    assert (inside & standing).any()


@pytest.mark.parametrize(
    ("changes", "column", "better"),
    [
        ({"index": "ksg", "threshold_nat": 1.0}, "ksg_x_nat", 1),
        ({"index": "variance", "threshold_std_kg": 12.0}, "predicted_std_x", -1),
    ],
    ids=["ksg", "variance"],
)
def test_another_gate_decides_by_its_own_column(start, changes, column, better):
    judged = gate_windows(start, settings(**changes))
    limit = changes.get("threshold_nat", changes.get("threshold_std_kg"))
    accepted = judged["accepted_x"].to_numpy()
    low = (judged["reason_x"] == "low_information").to_numpy()
    number = judged[column].to_numpy()
    assert accepted.any()
    assert (better * number[accepted] >= better * limit).all()
    assert (better * number[low] < better * limit).all()


def test_the_index_10_accepts_either_sign_of_the_dependence(start):
    """(10) takes ρ²: force against acceleration informs it as much as force along it."""
    opposed = start.with_columns(force_x_N=-pl.col("force_x_N"))
    along, against = (
        gate_windows(each, settings(index="gaussian", threshold_nat=0.7))
        for each in (start, opposed)
    )
    rho = along["corr_x_1"].to_numpy()
    accepted = along["accepted_x"].to_numpy()
    assert accepted.any()
    assert (-0.5 * np.log(1.0 - rho[accepted] ** 2) >= 0.7).all()
    low = (along["reason_x"] == "low_information").to_numpy()
    assert (-0.5 * np.log(1.0 - rho[low] ** 2) < 0.7).all()
    assert against["reason_x"].to_list() == along["reason_x"].to_list()
    assert not gate_windows(opposed, settings())["accepted_x"].any()


def test_ksg_is_computed_only_where_nothing_else_refuses_the_window(start):
    judged = gate_windows(start, settings(index="ksg"))
    settled = judged["reason_x"].is_in(["accepted", "low_information", "ill_conditioned"])
    np.testing.assert_array_equal(judged["ksg_x_nat"].is_not_null(), settled)
    assert "ksg_x_nat" not in gate_windows(start, settings()).columns
