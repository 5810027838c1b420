"""The calibration (19) as it is printed."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from analysis.calibration.line.point_errors import fit_error_slope_and_offset_kg


def test_a_hand_checked_example():
    # means 10, 20, 40 for references 1, 2, 3: alpha = 30 / (1400 / 3), beta = 2 - alpha 70 / 3
    line = fit_error_slope_and_offset_kg(np.array([10.0, 20.0, 40.0]), np.array([1.0, 2.0, 3.0]))
    assert line == pytest.approx((9 / 140, 0.5))


@given(st.lists(st.floats(1000, 9000), min_size=3, max_size=8))
def test_it_is_that_of_polyfit(masses):
    x, y = np.array(masses), 50.0 * np.arange(len(masses))
    assume(np.ptp(x) > 1.0)
    assert fit_error_slope_and_offset_kg(x, y) == pytest.approx(
        np.polyfit(x, y, 1), rel=1e-5, abs=1e-4
    )


def test_estimates_that_do_not_spread_give_none():
    assert fit_error_slope_and_offset_kg(np.full(3, 5.0), np.arange(3.0)) is None
