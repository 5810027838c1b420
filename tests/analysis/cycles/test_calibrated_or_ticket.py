"""Where a calibration and a ticket both tell the scale, the sum that is better known stands."""

import numpy as np
import polars as pl
import pytest

from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.cycles.calibrated_payloads import calibrate_cycles
from tests.analysis.calibration.campaigns import readings, references
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found

OWN_KG = 200.0
SCALE_1 = 1.1
LINE = fit_calibration_line(readings(), references(), np.eye(6), CalibrationOptions("joint_mass"))


def cycles(ticket_u_1: float, told_by: str = "empty machine") -> pl.DataFrame:
    """Cycles of a log whose scale is 10 % too small, by a ticket of some uncertainty."""
    kg = SCALE_1 * OWN_KG
    return found(drawn_shift([OWN_KG] * 5)).with_columns(
        payload_kg=pl.lit(kg),
        payload_u_common_kg=pl.lit(ticket_u_1 * kg),
        payload_u_shared_kg=pl.lit(ticket_u_1 * kg),
        own_u_common_kg=pl.lit(1.0),
        own_u_shared_kg=pl.lit(1.0),
        scale_1=pl.lit(SCALE_1),
        scale_from=pl.lit(told_by),
    )


def test_a_ticket_that_tells_more_than_the_line_stands():
    known = cycles(0.0)
    assert calibrate_cycles(known, LINE).equals(known)


def test_a_line_that_tells_more_than_the_ticket_takes_payloads_of_the_log_alone():
    made = calibrate_cycles(cycles(0.5), LINE)
    assert made["scale_from"].unique().to_list() == ["calibration"]
    assert made["payload_kg"].to_list() == pytest.approx([OWN_KG / LINE.c1_1] * 5)


def test_a_ticket_beside_which_something_stays_unknown_gives_way_to_the_line():
    made = calibrate_cycles(cycles(0.0, told_by=""), LINE)
    assert made["scale_from"].unique().to_list() == ["calibration"]
