"""The friction of each machine of a fleet, and when it reaches a limit."""

import pytest

from analysis.fleet.daily_figures import UNDATED
from replay.fleet.write_fleet_page import estimate_fleet_friction_trends
from tests.analysis.fleet.test_fleet_tables import results

DAY_NS = 86_400 * 10**9


def test_each_machine_has_a_trend_of_its_own() -> None:
    # 1 % a day from 3000 N·s/m: 3300 is reached after ten days
    rising = [
        {
            "machine": "rising",
            "t0_unix_ns": n * DAY_NS,
            "friction_x_N_s_m": 3000.0 + 30.0 * n + (-1.0) ** n,
            "friction_x_std_N_s_m": 5.0,
        }
        for n in range(7)
    ]
    other = {"machine": "new", "friction_x_N_s_m": 3000.0, "friction_x_std_N_s_m": 5.0}
    undated = {**rising[0], "day": UNDATED, "friction_x_N_s_m": 9000.0}
    trends = estimate_fleet_friction_trends(results(*rising, other, undated), 3300.0)
    assert list(trends) == ["new", "rising"]
    assert trends["new"].reached_d is None
    assert trends["rising"].reached_d == pytest.approx((10.0, 10.0), abs=1.0)
