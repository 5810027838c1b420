"""Error limits of OIML R 51 and R 134, with a guard band and the risk of a wrong verdict."""

from functools import cache

import numpy as np
import pytest

from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.use.error_limits import (
    CLASSES,
    DecisionRule,
    compute_error_limit_of_load_kg,
    judge_loads_by_error_limits,
)
from estimators.errors import DataError
from tests.analysis.calibration.campaigns import readings, references
from tests.twins import mark_heavy_after


@cache  # two classes are judged by the same forty lines
def fitted(deviations=(6.0, 2.0, 3.0), days=6, seed=2):
    rows = readings(seed, days=days, deviations=deviations)
    options = CalibrationOptions("joint_mass")
    return fit_calibration_line(rows, references(), 0.5**2 * np.eye(6), options)


@pytest.mark.parametrize(
    ("name", "load_e", "initial_e", "in_service_e"),
    [
        ("OIML R 51 Y(a)", 500.0, 1.5, 2.0),
        ("OIML R 51 Y(a)", 501.0, 2.0, 3.0),
        ("OIML R 51 Y(a)", 2000.0, 2.0, 3.0),
        ("OIML R 51 Y(a)", 9000.0, 2.5, 4.0),
        ("OIML R 51 Y(b)", 50.0, 1.5, 2.0),
        ("OIML R 51 Y(b)", 200.0, 2.0, 3.0),
        ("OIML R 51 Y(b)", 900.0, 2.5, 4.0),
    ],
)
def test_limits_of_r_51_go_by_steps_of_e(name, load_e, initial_e, in_service_e):
    for in_service, expected in ((False, initial_e), (True, in_service_e)):
        rule = DecisionRule(name, scale_interval_kg=5.0, in_service=in_service)
        assert compute_error_limit_of_load_kg(rule, 5.0 * load_e) == pytest.approx(5.0 * expected)


def test_limits_of_r_134_are_shares_of_the_mass():
    printed = {"0.2": 0.1, "0.5": 0.25, "1": 0.5, "2": 1.0, "5": 2.5, "10": 5.0}
    for name, percent in printed.items():
        rule = DecisionRule(f"OIML R 134 {name}")
        assert compute_error_limit_of_load_kg(rule, 4000.0) == pytest.approx(40.0 * percent)
        twice = DecisionRule(f"OIML R 134 {name}", in_service=True)
        assert compute_error_limit_of_load_kg(twice, 4000.0) == pytest.approx(80.0 * percent)


@pytest.mark.parametrize(
    ("rule", "said"),
    [
        (DecisionRule("OIML R 51 Y(c)"), "did you mean 'OIML R 51 Y"),
        (DecisionRule("OIML R 51 Y(a)"), "needs a scale interval"),
        (DecisionRule("OIML R 51 Y(a)", scale_interval_kg=0.0), "needs a scale interval"),
        (DecisionRule("OIML R 51 Y(b)", scale_interval_kg=0.09), "ends at 1000 e, and a load of"),
    ],
)
def test_a_class_that_is_none_is_refused(rule, said):
    with pytest.raises(DataError, match=said):
        compute_error_limit_of_load_kg(rule, 100.0)


def test_a_wide_class_is_kept_and_a_narrow_one_is_not():
    calibration = fitted()
    wide = judge_loads_by_error_limits(calibration, DecisionRule("OIML R 134 5"))
    assert wide.verdict == "within"
    assert wide.risk_1 < 1e-3
    assert wide.statement.startswith("within the error limits of OIML R 134 5")
    narrow = judge_loads_by_error_limits(
        calibration, DecisionRule("OIML R 51 Y(a)", 0.05, tare_kg=3614.0)
    )
    assert narrow.verdict == "outside"
    assert narrow.risk_1 < 0.05
    between = judge_loads_by_error_limits(
        calibration, DecisionRule("OIML R 134 0.2", in_service=True)
    )
    assert between.verdict == "undecided"
    for found in (wide, narrow, between):
        assert "conform" not in found.statement
        assert len(found.rows) == 6


def test_the_guard_band_leaves_the_risk_that_was_asked_for():
    calibration = fitted()
    rule = DecisionRule("OIML R 134 0.5", risk_1=0.05)
    for row in judge_loads_by_error_limits(calibration, rule).rows:
        # an error at the edge of what is accepted is beyond the limit with that risk
        edge = calibration.inversion.compute_exceedance_probability(
            row.guard_kg, row.load_kg, calibration.budget_at[1]
        )
        assert edge == pytest.approx(0.05, abs=1e-4)
        assert (row.verdict == "within") == (row.outside_1 <= 0.05)


@pytest.mark.heavy
@pytest.mark.parametrize("name", mark_heavy_after(1, ["OIML R 134 0.5", "OIML R 134 1"]))
def test_what_is_said_to_be_within_is_within(name):
    """Of later masses few are accepted and err by more than the limit."""
    dice = np.random.default_rng(8)
    accepted = wrong = 0
    rule = DecisionRule(name)
    for seed in range(40):
        calibration = fitted(seed=seed)
        within = judge_loads_by_error_limits(calibration, rule).verdict == "within"
        for _ in range(20):
            true = dice.uniform(3614.0, 3864.0)
            noise = dice.normal(0.0, np.sqrt(6.0**2 / 4 + 2.0**2 + 3.0**2))
            found = calibration.calibrate_estimate(100.0 + 1.02 * true + noise, None, 4)
            accepted += within
            wrong += within and abs(
                (found.mass_kg or true) - true
            ) > compute_error_limit_of_load_kg(rule, true)
    assert accepted >= 20
    assert wrong / 800 < rule.risk_1
    assert name == "OIML R 134 0.5" or wrong / accepted < rule.risk_1


def test_every_class_has_its_limit():
    for name in CLASSES:
        assert (
            compute_error_limit_of_load_kg(DecisionRule(name, scale_interval_kg=10.0), 1000.0) > 0.0
        )
