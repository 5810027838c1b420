"""A machine against one known mass since its calibration."""

import numpy as np
import pytest

from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.use.calibration_drift import (
    CheckPoint,
    compare_known_mass_with_calibration,
)
from estimators.errors import DataError
from tests.analysis.calibration.campaigns import readings, references

KNOWN_KG = 3764.0


def fitted(seed=2, **campaign):
    options = CalibrationOptions("joint_mass")
    return fit_calibration_line(readings(seed, **campaign), references(), np.eye(6), options)


def said(mass_kg, drift_kg=0.0):
    return CheckPoint(100.0 + 1.02 * (mass_kg + drift_kg), None, 4)


def test_a_machine_that_says_the_known_mass_has_not_drifted():
    found = compare_known_mass_with_calibration(fitted(), KNOWN_KG, 1.0, said(KNOWN_KG))
    assert found.drifted is False
    assert abs(found.difference_kg) < found.limit_kg
    assert found.p_1 > 0.05
    assert found.missed_1 < 0.05


def test_a_machine_that_is_far_off_has_drifted_even_where_it_leaves_the_range():
    found = compare_known_mass_with_calibration(fitted(), KNOWN_KG, 1.0, said(KNOWN_KG, 500.0))
    assert found.drifted is True
    assert found.p_1 < 1e-3
    assert found.difference_kg == pytest.approx(500.0, abs=40.0)


def test_limit_and_probability_agree():
    calibration = fitted()
    for drift in np.linspace(-60.0, 60.0, 13):
        found = compare_known_mass_with_calibration(
            calibration, KNOWN_KG, 1.0, said(KNOWN_KG, drift)
        )
        assert found.drifted == (found.p_1 < 0.05)


def test_the_risk_of_a_miss_falls_with_the_drift_that_matters():
    calibration = fitted()
    missed = [
        compare_known_mass_with_calibration(
            calibration, KNOWN_KG, 1.0, said(KNOWN_KG), matters
        ).missed_1
        for matters in (1.0, 20.0, 40.0, 80.0)
    ]
    assert missed == sorted(missed, reverse=True)
    assert missed[0] > 0.9
    assert missed[-1] < 0.05


@pytest.mark.slow
def test_a_machine_as_calibrated_is_called_drifted_as_often_as_stated():
    dice = np.random.default_rng(3)
    alarms = []
    for seed in range(300):
        calibration = fitted(seed)
        noise = dice.normal(0.0, np.sqrt(20.0**2 / 4 + 8.0**2 + 10.0**2))
        point = CheckPoint(100.0 + 1.02 * KNOWN_KG + noise, None, 4)
        alarms.append(
            compare_known_mass_with_calibration(calibration, KNOWN_KG, 1.0, point).drifted
        )
    # 300 campaigns know 5 % to 1.3 %
    assert 0.01 < np.mean(alarms) < 0.09


@pytest.mark.parametrize(
    ("reference_kg", "point", "why"),
    [
        (5000.0, said(5000.0), "outside of the range"),
        (KNOWN_KG, CheckPoint(None, None, 4), "no estimate"),
        (KNOWN_KG, CheckPoint(3900.0, None, 0), "no estimate"),
    ],
)
def test_nothing_is_said_where_nothing_can_be_compared(reference_kg, point, why):
    found = compare_known_mass_with_calibration(fitted(), reference_kg, 1.0, point)
    assert found.drifted is None
    assert why in found.reason


@pytest.mark.parametrize("u", [-1.0, float("nan")])
def test_an_uncertainty_that_is_no_size_is_refused(u):
    with pytest.raises(DataError, match="must be a number of at least 0 kg"):
        compare_known_mass_with_calibration(fitted(), KNOWN_KG, u, said(KNOWN_KG))
