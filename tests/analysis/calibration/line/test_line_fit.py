"""A calibration fitted to the readings of a campaign."""

import json

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.calibration.line.calibration import Calibration, CalibrationOptions, StatedPart
from analysis.calibration.line.line_fit import fit_calibration_line
from estimators.errors import DataError
from tests.analysis.calibration.campaigns import readings, references

OPTIONS = CalibrationOptions("joint_mass")
COVARIANCE = 2.0**2 * np.eye(6) + 1.0


def fitted(rows=None, covariance=COVARIANCE, options=OPTIONS, **campaign):
    rows = readings(**campaign) if rows is None else rows
    return fit_calibration_line(rows, references(), covariance, options)


def row(calibration, component):
    (found,) = (one for one in calibration.budget if one.component == component)
    return found


def test_exact_readings_give_the_line_back():
    found = fitted(deviations=(0.0, 0.0, 0.0), covariance=np.zeros((6, 6)))
    assert found.c1_1 == pytest.approx(1.02)
    assert found.c0_kg == pytest.approx(100.0)
    assert found.alpha_1 == pytest.approx(1 / 1.02)
    assert found.beta_kg == pytest.approx(-100.0 / 1.02)
    assert found.rms_error_kg < 1e-6
    assert found.rms_error_left_out_kg < 1e-6
    mass = found.calibrate_estimate(100.0 + 1.02 * 3700.0, None, 4)
    assert mass.mass_kg == pytest.approx(3700.0)


def test_a_calibration_survives_json_exactly_and_has_no_number_that_json_lacks():
    found = fitted()
    text = json.dumps(found.to_dict(), allow_nan=False)
    assert Calibration.from_dict(json.loads(text)) == found


@pytest.mark.parametrize(
    "change",
    [
        {"alpha_1": "0.98"},
        {"alpha_1": float("nan")},
        {"more": 1},
        {"components": 3},
        {"points": [{"run_id": "x"}]},
    ],
)
def test_what_is_no_calibration_is_refused_in_one_line(change):
    with pytest.raises(DataError) as error:
        Calibration.from_dict({**fitted().to_dict(), **change})
    assert "\n" not in str(error.value)


def test_the_same_readings_give_the_same_numbers_in_any_order_of_their_runs():
    rows = readings()
    first, other = fitted(rows), fitted(rows.reverse())
    assert other.alpha_1 == pytest.approx(first.alpha_1, rel=1e-9)
    assert other.u_kg == pytest.approx(first.u_kg, rel=1e-6)


def test_the_budget_adds_up_to_the_uncertainty():
    stated = (
        StatedPart("tare", 3.0, absorbed=False, known="fuel, half a tank"),
        StatedPart("wheel radius", 60.0, absorbed=True, known="machine file"),
    )
    for campaign in ({}, {"days": 1}, {"days": 1, "common_u_kg": 40.0}, {"days": 3, "seed": 4}):
        found = fitted(options=CalibrationOptions("joint_mass", stated=stated), **campaign)
        total = np.sqrt(sum(one.u_kg**2 for one in found.budget if one.u_kg is not None))
        assert total == pytest.approx(found.u_kg, rel=1e-9)
        mass = found.calibrate_estimate(
            found.c0_kg + found.c1_1 * found.budget_at[0], None, found.budget_at[1]
        )
        assert mass.u_kg == pytest.approx(found.u_kg)
        half = (mass.high_kg - mass.low_kg) / 2.0
        assert half == pytest.approx(found.coverage_k_1 * found.u_kg, rel=0.02)
    assert {one.component for one in found.budget} >= {
        "wheel radius", "force share", "local gravity", "tare", "references", "slope",
        "repeatability", "run to run", "day to day", "lack of fit", "common error",
    }  # fmt: skip
    assert row(found, "wheel radius").u_kg == 0.0
    assert f"{60.0 / found.c1_1:.3g} kg without a calibration" in row(found, "wheel radius").known
    assert row(found, "force share").u_kg is None


def test_an_error_that_all_references_share_moves_the_level_and_no_residual():
    alone = fitted(covariance=np.eye(6))
    shared = fitted(covariance=np.eye(6) + 30.0**2)
    assert shared.alpha_1 == pytest.approx(alone.alpha_1, rel=1e-6)
    assert shared.chi2_1 == pytest.approx(alone.chi2_1, rel=1e-4)
    assert row(shared, "references").u_kg == pytest.approx(30.0, rel=0.02)
    assert row(shared, "repeatability").u_kg == pytest.approx(row(alone, "repeatability").u_kg)


def test_common_error_is_no_noise_of_a_point_and_counts_once_while_one_day_is_all_there_is():
    without = fitted(days=1, runs=2)
    one_day = fitted(days=1, runs=2, common_u_kg=51.0)
    assert one_day.alpha_1 == without.alpha_1
    assert one_day.covariance == without.covariance
    assert row(one_day, "common error").u_kg == pytest.approx(51.0 / one_day.c1_1)
    assert one_day.u_kg == pytest.approx(np.hypot(without.u_kg, 51.0 / one_day.c1_1))
    assert any("unknown" in said for said in one_day.says)
    # several days show whether it stays, and the line takes what does
    several = fitted(days=5, common_u_kg=51.0)
    assert several.u_kg == fitted(days=5).u_kg
    assert row(several, "common error").kind == "absorbed"


def test_days_are_told_from_runs_only_where_they_can_be():
    assert fitted(days=1).day_kg is None
    assert row(fitted(days=1), "day to day").u_kg is None
    known = fitted(days=1, options=CalibrationOptions("joint_mass", day_known_kg=10.2))
    assert known.day_kg == pytest.approx(10.2)
    assert row(known, "day to day").u_kg == pytest.approx(10.2 / known.c1_1)
    assert known.day_freedom is None
    five = fitted(days=5)
    assert five.day_freedom == 4
    each_its_own = readings(days=1, runs=2).with_columns(day=pl.col("run_id"))
    found = fitted(each_its_own)
    assert found.day_kg is None
    assert any("run to run has it in it" in said for said in found.says)


def test_the_fewest_points_that_show_a_line_are_three():
    rows = readings(days=1, each=1).filter(pl.col("load_id").is_in(["load 0", "load 2", "load 5"]))
    found = fitted(rows)
    assert found.freedom == 1
    assert found.repeatability_kg is None
    of_two_days = rows.with_columns(day=pl.Series(["a", "a", "b"]))
    assert fitted(of_two_days).day_kg is None
    assert any("run to run has it in it" in said for said in fitted(of_two_days).says)


def test_fewer_days_have_wider_intervals():
    wide = [fitted(days=days, seed=9).coverage_k_1 for days in (2, 3, 5, 8)]
    assert wide[0] > wide[1] > 2.5 > wide[2] > 1.96
    assert wide[3] < 2.4


def test_a_curved_machine_has_a_lack_of_fit_that_widens_every_interval():
    straight = readings(days=4, runs=2, deviations=(10.0, 3.0, 3.0))
    load = pl.col("load_id").str.slice(-1).cast(pl.Float64)
    curved = straight.with_columns(mass_kg=pl.col("mass_kg") + 6.0 * (load - 2.5) ** 2)
    fine, bent = fitted(straight), fitted(curved)
    assert fine.lack_of_fit.p_1 > 0.05
    assert bent.lack_of_fit.p_1 < 1e-6
    assert bent.lack_of_fit.freedom[0] == 4
    assert row(bent, "lack of fit").u_kg > 5.0
    assert bent.u_kg > 2.0 * fine.u_kg
    assert any(said.startswith("lack of fit") for said in bent.says)


def test_without_a_second_run_of_a_load_lack_of_fit_is_tested_against_the_readings():
    found = fitted(days=1, deviations=(20.0, 0.0, 0.0), covariance=np.zeros((6, 6)))
    assert found.lack_of_fit.freedom == (4, 18)
    assert "run to run would look the same" in found.lack_of_fit.against


def test_an_outlier_is_named_and_stays_in_the_fit():
    rows = readings(each=6)
    at = (pl.col("run_id") == "2/3/0") & (pl.col("reading") == 4)
    wrong = rows.with_columns(mass_kg=pl.col("mass_kg") + pl.when(at).then(400.0).otherwise(0.0))
    found = fitted(wrong)
    named = {one.about for one in found.outliers}
    assert "reading 4 of run '2/3/0'" in named
    assert all(one.p_1 < 0.05 for one in found.outliers)
    (point,) = (one for one in found.points if one.run_id == "2/3/0")
    assert point.readings == 6
    assert point.mean_kg == pytest.approx(wrong.filter(run_id="2/3/0")["mass_kg"].mean(), rel=1e-12)
    assert any("it is in the fit" in said for said in found.says)


@pytest.mark.heavy
def test_outliers_are_found_by_chance_in_one_campaign_of_ten_at_most():
    found = sum(bool(fitted(seed=seed).outliers) for seed in range(60))
    # two tests at 5 % each
    assert found <= 13


def test_rejected_readings_and_empty_runs_stay_listed():
    rows = readings().with_columns(
        used=(pl.col("run_id") != "1/2/0") & (pl.col("reading") != 0),
        mass_kg=pl.when(pl.col("reading") == 1).then(None).otherwise(pl.col("mass_kg")),
    )
    found = fitted(rows)
    by_id = {point.run_id: point for point in found.points}
    assert len(by_id) == 30
    empty = by_id["1/2/0"]
    assert (empty.readings, empty.rejected, empty.mean_kg) == (0, 4, None)
    assert (by_id["0/0/0"].readings, by_id["0/0/0"].rejected) == (2, 2)


def test_errors_with_a_load_left_out_are_those_of_a_fit_without_it():
    rows = readings(days=1, runs=2)
    found = fitted(rows, covariance=np.zeros((6, 6)))
    without = rows.filter(pl.col("load_id") != "load 5")
    means = without.group_by("run_id", "load_id", maintain_order=True).agg(pl.col("mass_kg").mean())
    x = 3614.0 + 50.0 * means["load_id"].str.slice(-1).cast(pl.Float64).to_numpy()
    slope, level = np.polyfit(x - 3700.0, means["mass_kg"].to_numpy(), 1)
    for point in found.points:
        if point.load_id == "load 5":
            expected = (point.mean_kg - level) / slope + 3700.0 - 3864.0
            assert point.error_left_out_kg == pytest.approx(expected, rel=1e-6)
    assert found.rms_error_left_out_kg > found.rms_error_kg


def test_attenuation_is_what_single_readings_do_to_the_paper_s_line():
    found = fitted(days=1, runs=1, each=400, deviations=(38.0, 0.0, 0.0), line=(0.0, 1.0))
    spread = np.var(50.0 * np.arange(6))
    assert found.attenuation_1 == pytest.approx(spread / (spread + 38.0**2), abs=0.01)
    assert any("(19) fitted to single readings" in said for said in found.says)


def test_the_paper_s_slope_is_said_to_leave_most_of_the_output_to_beta():
    steep = readings(line=(2100.0 - 7.4 * 3614.0, 7.4), deviations=(100.0, 30.0, 30.0))
    found = fitted(steep)
    assert found.alpha_1 == pytest.approx(0.135, rel=0.1)
    assert any("% of a calibrated mass is the offset beta" in said for said in found.says)


def test_readings_that_scatter_more_than_they_state_are_seen():
    rows = readings(each=9).with_columns(std_kg=pl.lit(10.0))
    assert fitted(rows).stated_ratio_1 == pytest.approx(2.0, rel=0.15)


def test_estimates_that_do_not_follow_the_loads_calibrate_nothing_and_say_so():
    dice = np.random.default_rng(2)
    rows = readings().with_columns(mass_kg=pl.Series(3700.0 + dice.normal(0.0, 20.0, 120)))
    found = fitted(rows)
    assert found.alpha_interval_1 == (None, None)
    assert any("told from 0" in said for said in found.says)
    assert "told from 0" in found.calibrate_estimate(3700.0, None, 4).reason
    json.dumps(found.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("mass_kg", "readings_", "said"),
    [
        (None, 3, "no estimate"),
        (float("nan"), 3, "no estimate"),
        (3800.0, 0, "no estimate"),
        (5000.0, 3, "outside of the calibrated range, 3614 to 3864 kg"),
        (3000.0, 3, "outside of the calibrated range"),
    ],
)
def test_a_mass_that_the_calibration_cannot_give_is_null_with_the_reason(mass_kg, readings_, said):
    found = fitted().calibrate_estimate(mass_kg, None, readings_)
    assert (found.mass_kg, found.u_kg, found.low_kg, found.high_kg) == (None,) * 4
    assert said in found.reason


def test_the_range_is_that_of_the_references_and_a_margin_that_is_asked_for():
    wider = fitted(options=CalibrationOptions("joint_mass", margin_1=0.2))
    assert wider.range_kg == (3564.0, 3914.0)
    # an empty machine may read below its own mass
    just_below = fitted().calibrate_estimate(100.0 + 1.02 * 3600.0, None, 4)
    assert just_below.mass_kg < 3614.0


def test_a_run_that_states_more_than_the_campaign_s_readings_has_a_wider_interval():
    found = fitted()
    plain, own, small = (found.calibrate_estimate(3900.0, u, 4) for u in (None, 60.0, 0.1))
    assert own.u_kg > 50.0 > plain.u_kg
    assert small == plain


def test_more_readings_narrow_an_interval_down_to_what_they_share():
    found = fitted()
    one, four, many = (found.calibrate_estimate(3900.0, None, n).u_kg for n in (1, 4, 4000))
    assert one > four > many > 5.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: r.filter(pl.col("load_id").is_in(["load 0", "load 1"])), "2 different loads"),
        (lambda r: r.with_columns(used=False), "0 different loads"),
        (lambda r: r.with_columns(mass_kg=pl.lit(3614.0)), "are equal for all loads"),
        (lambda r: r.with_columns(run_id=pl.lit("x")), "several loads or days"),
        (
            lambda r: r.with_columns(load_id=pl.lit("gold")),
            "load 'gold' has readings but no reference",
        ),
        (lambda r: r.drop("day"), "no column 'day'"),
    ],
)
def test_readings_that_no_line_can_be_fitted_to_are_refused(change, said):
    with pytest.raises(DataError, match=said):
        fitted(change(readings()))


@pytest.mark.parametrize(
    ("covariance", "said"),
    [
        (np.eye(5), "must be 6 by 6 finite"),
        (np.triu(np.ones((6, 6))), "not symmetric"),
        (-np.eye(6), "not positive semidefinite"),
        (np.full((6, 6), np.nan), "must be 6 by 6 finite"),
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance, said):
    with pytest.raises(DataError, match=said):
        fitted(covariance=covariance)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(1, 5),
    st.integers(1, 3),
    st.integers(1, 5),
    st.floats(0.0, 50.0),
    st.floats(0.0, 30.0),
)
def test_any_campaign_gives_an_interval_about_its_mass(seed, days, runs, each, rep, day):
    found = fitted(seed=seed, days=days, runs=runs, each=each, deviations=(rep, 5.0, day))
    mass = found.calibrate_estimate(found.c0_kg + found.c1_1 * 3739.0, None, each)
    if mass.mass_kg is None:
        assert "told from 0" in mass.reason
    else:
        assert mass.low_kg < mass.mass_kg < mass.high_kg
        assert mass.u_kg > 0.0
    json.dumps(found.to_dict(), allow_nan=False)
