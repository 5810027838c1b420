"""Simulated years of machines: drifts are flagged in time, and hardly anything else.

`make fleet-years` does it with hundreds of years.
"""

import pytest

from analysis.fleet.machine_drifts import make_machine_charts
from benchmarks.fleet_years import alarms, flagged, year


@pytest.mark.parametrize(
    ("signal", "drift"), [("zero", {"zero_a_month": 1.0}), ("friction", {"friction": 2.0})]
)
def test_a_drift_is_flagged_within_three_months(signal: str, drift: dict[str, float]) -> None:
    after = [flagged(make_machine_charts(year(1000 + n, **drift)), signal) for n in range(20)]
    assert sum(each is not None and each <= 91 for each in after) >= 19


def test_without_drift_there_is_at_most_one_alarm_a_machine_and_year() -> None:
    assert sum(alarms(year(2000 + n)) for n in range(20)) <= 20


def test_after_a_calibration_the_baseline_is_found_anew() -> None:
    import polars as pl

    days = year(3000, zero_a_month=1.0)
    half = days.height // 2
    ids = pl.Series("calibration", ["a"] * half + ["b"] * (days.height - half))
    charts = [c for c in make_machine_charts(days.with_columns(ids)) if c.signal.name == "zero"]
    assert [chart.calibration for chart in charts] == ["a", "b"]
    assert [len(chart.days) for chart in charts] == [half, days.height - half]
    assert charts[1].chart.cusum_up[0] == 0.0
