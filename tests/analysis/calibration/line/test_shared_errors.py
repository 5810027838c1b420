"""Errors that a log shares with its campaign: what the line took, and what is left."""

import numpy as np
import polars as pl
import pytest

from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.line.shared_errors import RunResponse, SharedErrors
from analysis.calibration.use.apply_calibration import LaterLog, calibrate_loads
from analysis.calibration.use.mass_differences import calibrate_mass_differences
from tests.analysis.calibration.campaigns import readings, references

TERM = "load_transfer"


def calibration(level_kg=-48.0, slope_1=0.0, line=(0.0, 1.0), random_kg=5.0, **more):
    """A line whose points one uncertainty of a learnt mean moved by level and slope."""
    table = readings(deviations=(random_kg, 0.0, 0.0), line=line, **more)
    masses = dict(references().iter_rows())
    said = [
        RunResponse(
            run_id=run,
            term=TERM,
            response_kg=level_kg + slope_1 * (masses[load] - 3739.0),
        )
        for run, load in table.select("run_id", "load_id").unique(maintain_order=True).iter_rows()
    ]
    return fit_calibration_line(
        table, references(), np.zeros((6, 6)), CalibrationOptions("joint_mass"), said
    )


def log(moved_kg, error_1=0.0, std_1=1.0, of=("mass", 0), scale_kg=0.0, is_corrected=False):
    return SharedErrors(
        (TERM,),
        np.array([error_1]),
        np.array([[std_1**2]]),
        np.array([is_corrected]),
        {of: np.array([moved_kg])},
        {of: scale_kg},
    )


def loads(**more):
    row = {
        "load_id": 0,
        "manoeuvres": 4,
        "mass_kg": 3739.0,
        "u_random_kg": 2.0,
        "own_payload_kg": None,
        "own_payload_u_kg": None,
        "own_payload_u_random_kg": None,
        "payload_to": None,
        "empty": False,
        "withheld_for": "",
    }
    return pl.DataFrame([row | more], infer_schema_length=None)


def test_a_log_driven_as_its_campaign_was_pays_nothing_for_what_they_share():
    line = calibration()
    alone = calibrate_loads(loads(), line).row(0, named=True)
    alike = calibrate_loads(loads(), line, LaterLog(shared_errors=log(-48.0))).row(0, named=True)
    assert alike["calibrated_kg"] == pytest.approx(alone["calibrated_kg"])
    assert alike["calibrated_u_kg"] == pytest.approx(alone["calibrated_u_kg"])
    assert alike["calibrated_unlike_u_kg"] == pytest.approx(0.0, abs=1e-6)


def test_a_log_driven_otherwise_pays_for_the_difference_of_the_responses():
    line = calibration()
    found = calibrate_loads(loads(), line, LaterLog(shared_errors=log(2.0))).row(0, named=True)
    assert found["calibrated_unlike_u_kg"] == pytest.approx(50.0, rel=0.01)
    half = (found["calibrated_high_kg"] - found["calibrated_low_kg"]) / 2.0
    assert half > 1.9 * 50.0


def test_what_the_log_says_of_the_error_is_taken_off_and_narrows():
    line = calibration()
    plain = calibrate_loads(loads(), line, LaterLog(shared_errors=log(2.0))).row(0, named=True)
    told = log(2.0, error_1=0.4, std_1=0.1)
    found = calibrate_loads(loads(), line, LaterLog(shared_errors=told)).row(0, named=True)
    assert found["calibrated_kg"] == pytest.approx(plain["calibrated_kg"] - 0.4 * 50.0, abs=0.2)
    assert found["calibrated_unlike_u_kg"] == pytest.approx(5.0, rel=0.01)


def test_masses_that_have_an_error_off_already_lack_what_the_line_has_of_it():
    line = calibration()
    # as what the log says is taken off masses that have it: 3739 - 0.4 (2 - -48), both ways
    fixed = log(2.0, error_1=0.4, std_1=0.1)
    told = log(2.0, error_1=0.4, std_1=0.1, is_corrected=True)
    one = calibrate_loads(loads(), line, LaterLog(shared_errors=fixed)).row(0, named=True)
    off = loads(mass_kg=3739.0 - 0.4 * 2.0)
    other = calibrate_loads(off, line, LaterLog(shared_errors=told)).row(0, named=True)
    assert other["calibrated_kg"] == pytest.approx(one["calibrated_kg"], abs=0.1)
    assert other["calibrated_u_kg"] == pytest.approx(one["calibrated_u_kg"], rel=0.01)


def test_of_a_difference_the_line_takes_scale_and_shared_errors_by_its_slope():
    # in proportion to the mass, so that level and slope of the line say the same
    line = calibration(level_kg=0.02 * 3739.0, slope_1=0.02)
    of = ("cycle", 1)
    like = calibrate_mass_differences(line, log(2.0, of=of, scale_kg=3.0), [of], np.array([100.0]))
    # the campaign's responses grow by 0.02 for each kg as well: 2 kg of 100 are in the slope
    assert like.driving_u_kg[0] == pytest.approx(0.0, abs=0.05)
    assert like.absorbed_u_kg[0] == pytest.approx(np.hypot(2.0, 3.0), rel=0.01)
    assert like.compute_unabsorbed_common_u_kg(np.array([5.0]))[0] == pytest.approx(
        np.sqrt(25.0 - 13.0), rel=0.02
    )
    other = calibrate_mass_differences(line, log(32.0, of=of), [of], np.array([100.0]))
    assert other.driving_u_kg[0] == pytest.approx(30.0, rel=0.02)


def test_a_slope_that_has_rolling_resistance_in_it_is_no_gain_of_a_difference():
    # the gain is right: what the line has at its centre is the mass there
    line = calibration(5.0, line=(-0.1 * 3739.0, 1.1), random_kg=1.0)
    of = ("payload", 0)
    found = calibrate_mass_differences(line, log(0.0, of=of), [of], np.array([200.0]))
    assert found.payload_kg[0] == pytest.approx(200.0, abs=1.0)
    assert found.line_u_kg[0] < 1.0


def test_a_gain_of_the_force_is_in_level_and_slope_alike():
    line = calibration(5.0, line=(0.0, 1.03), random_kg=1.0)
    of = ("payload", 0)
    found = calibrate_mass_differences(line, log(0.0, of=of), [of], np.array([206.0]))
    assert found.payload_kg[0] == pytest.approx(200.0, abs=0.5)


def test_a_slope_far_from_any_gain_is_the_machine_s_own():
    # behind a torque chain that sees one axle, alpha is 0.14 and beta nearly all
    line = calibration(5.0, line=(-22434.0, 7.0), random_kg=1.0)
    of = ("payload", 0)
    found = calibrate_mass_differences(line, log(0.0, of=of), [of], np.array([700.0]))
    assert found.payload_kg[0] == pytest.approx(100.0, rel=0.01)


def test_evidence_that_does_not_say_what_moved_its_line_leaves_all_of_it_in():
    line = fit_calibration_line(
        readings(), references(), np.zeros((6, 6)), CalibrationOptions("joint_mass")
    )
    of = ("cycle", 1)
    found = calibrate_mass_differences(line, log(75.0, of=of), [of], np.array([1000.0]))
    assert found.compute_unabsorbed_common_u_kg(np.array([80.0]))[0] == pytest.approx(
        80.0 / abs(line.c1_1)
    )


def test_a_payload_by_difference_is_on_the_line_with_its_interval():
    line = calibration()
    row = {
        "own_payload_kg": 120.0,
        "own_payload_u_kg": 6.0,
        "own_payload_u_random_kg": 3.0,
        "payload_to": 1,
    }
    found = calibrate_loads(loads(**row), line).row(0, named=True)
    assert found["calibrated_payload_kg"] == pytest.approx(line.alpha_1 * 120.0)
    low, high = found["calibrated_payload_low_kg"], found["calibrated_payload_high_kg"]
    assert found["calibrated_payload_u_kg"] >= 6.0 * abs(line.alpha_1)
    assert (high - low) / 2.0 >= 1.96 * found["calibrated_payload_u_kg"]


def test_an_empty_part_that_weighs_otherwise_refuses_the_calibration_of_the_log():
    line = calibration()
    both = pl.concat(
        [
            loads(load_id=0, mass_kg=3614.0 * 1.01, empty=True),
            loads(load_id=1, mass_kg=3700.0),
        ],
        how="vertical_relaxed",
    )
    reasons = calibrate_loads(both, line, LaterLog(empty_kg=3614.0))["calibrated_reason"]
    assert all("but 3,614 kg by its stated mass" in reason for reason in reasons)
    right = both.with_columns(mass_kg=pl.Series([3616.0, 3700.0]))
    reasons = calibrate_loads(right, line, LaterLog(empty_kg=3614.0))["calibrated_reason"]
    assert reasons.to_list() == ["", ""]


def test_evidence_of_few_days_says_so_unless_the_log_has_an_empty_part():
    line = calibration(days=1)
    unseen = {0: "no log can reveal it", 1: "no log can reveal it"}
    said = calibrate_loads(loads(), line, LaterLog(undetectable_change_text_by_load=unseen))[
        "calibrated_said"
    ]
    assert said.to_list() == ["evidence of one day: no log can reveal it"]
    two = calibrate_loads(
        loads(), calibration(days=2), LaterLog(undetectable_change_text_by_load=unseen)
    )
    assert two["calibrated_said"].to_list() == ["evidence of 2 days: no log can reveal it"]
    empty = pl.concat([loads(mass_kg=3614.0, empty=True), loads(load_id=1)], how="vertical_relaxed")
    told = LaterLog(undetectable_change_text_by_load=unseen, empty_kg=3614.0)
    assert calibrate_loads(empty, line, told)["calibrated_said"].to_list() == ["", ""]
    several = calibrate_loads(
        loads(), calibration(), LaterLog(undetectable_change_text_by_load=unseen)
    )
    assert several["calibrated_said"].to_list() == [""]


def test_an_interval_that_says_less_than_the_range_is_no_calibrated_mass():
    line = calibration()
    wide = calibrate_loads(loads(), line, LaterLog(shared_errors=log(200.0))).row(0, named=True)
    assert wide["calibrated_kg"] is None
    assert "is more than the calibrated range" in wide["calibrated_reason"]
