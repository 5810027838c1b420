"""Calibrated masses beside the raw ones of a log's loads."""

import numpy as np
import polars as pl
import pytest

from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.use.apply_calibration import calibrate_loads
from analysis.model.schema import CALIBRATED
from estimators.errors import DataError
from tests.analysis.calibration.campaigns import readings, references


def fitted(method="joint_mass"):
    options = CalibrationOptions(method)
    return fit_calibration_line(readings(), references(), np.eye(6), options)


LOADS = pl.DataFrame(
    {
        "load_id": [0, 1, 2, 3],
        "manoeuvres": [3, 4, 4, 0],
        "mass_kg": [3860.0, 3900.0, 6000.0, None],
        "u_random_kg": [None, 12.0, 12.0, None],
        "own_payload_kg": [0.0, 3800.0, 2140.0, None],
        "own_payload_u_random_kg": [None, 15.0, 15.0, None],
        "own_payload_u_kg": [None, 60.0, 60.0, None],
        "payload_to": [None, None, None, None],
        "empty": [False, False, False, False],
        "withheld_for": ["", "", "", "relative_u"],
    }
)


def test_each_load_has_its_calibrated_mass_or_the_reason_why_not():
    calibration = fitted()
    table = calibrate_loads(LOADS, calibration)
    expected = calibration.calibrate_estimate(3900.0, 12.0, 4)
    row = table.row(1, named=True)
    assert row["calibrated_kg"] == expected.mass_kg
    assert row["calibrated_u_kg"] == expected.u_kg
    assert (row["calibrated_low_kg"], row["calibrated_high_kg"]) == (
        expected.low_kg,
        expected.high_kg,
    )
    reasons = table["calibrated_reason"].to_list()
    assert reasons[:2] == ["", ""]
    assert "outside of the calibrated range" in reasons[2]
    assert reasons[3] == "withheld for relative_u"
    assert table["calibrated_kg"].null_count() == 2
    assert table.columns[-len(CALIBRATED) :] == list(CALIBRATED)


def test_a_calibration_of_payloads_takes_payloads():
    table = calibrate_loads(LOADS, fitted("joint_payload"))
    expected = fitted("joint_payload").calibrate_estimate(3800.0, 15.0, 4)
    assert table["calibrated_kg"][1] == expected.mass_kg


def test_another_calibration_replaces_the_columns():
    once = calibrate_loads(LOADS, fitted())
    assert calibrate_loads(once, fitted()).equals(once)


def test_a_calibration_of_another_estimator_is_refused():
    with pytest.raises(DataError, match="joint_mass"):
        calibrate_loads(LOADS, fitted("ls"))
