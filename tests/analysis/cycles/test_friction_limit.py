"""The day at which friction reaches a limit: an interval that holds, or nothing."""

import numpy as np
import pytest

from analysis.cycles.friction_trend import FrictionDay, fit_daily_friction_trend

BASE_N_S_M = 3000.0


def week(
    rise_1: float, noise_1: float = 0.01, *, seed: int = 1, days: int = 7
) -> list[FrictionDay]:
    """A shift a day, whose friction rises by a share over a week."""
    drawn = np.random.default_rng(seed).normal(0.0, noise_1, days)
    return [
        FrictionDay(d, BASE_N_S_M * (1.0 + rise_1 * d / 6.0 + e), BASE_N_S_M * noise_1)
        for d, e in enumerate(drawn.tolist())
    ]


def test_a_rise_of_ten_percent_in_a_week_is_dated_within_its_interval_in_95_of_100_weeks() -> None:
    # 15 % more is reached after nine days
    limit, true_d = 1.15 * BASE_N_S_M, 9.0
    found = [fit_daily_friction_trend(week(0.10, seed=k), limit).reached_d for k in range(400)]
    held = [each is not None and each[0] <= true_d <= each[1] for each in found]
    assert np.mean(held) >= 0.93
    wide_d = [each[1] - each[0] for each in found if each is not None]
    assert np.median(wide_d) < 6.0


def test_the_scatter_of_the_days_counts_where_their_own_uncertainty_is_too_small() -> None:
    limit, true_d = 1.15 * BASE_N_S_M, 9.0
    shy = [
        [day._replace(std_N_s_m=day.std_N_s_m / 5.0) for day in week(0.10, seed=k)]
        for k in range(400)
    ]
    found = [fit_daily_friction_trend(each, limit).reached_d for each in shy]
    assert np.mean([f is not None and f[0] <= true_d <= f[1] for f in found]) >= 0.9


def test_friction_that_does_not_change_has_no_day() -> None:
    said = [fit_daily_friction_trend(week(0.0, seed=k), 1.15 * BASE_N_S_M) for k in range(200)]
    assert np.mean([each.reached_d is None for each in said]) >= 0.93
    assert said[0].why_not == "no trend beyond its uncertainty"


def test_friction_that_falls_reaches_no_upper_limit() -> None:
    found = fit_daily_friction_trend(week(-0.2), 1.15 * BASE_N_S_M)
    assert (found.reached_d, found.why_not) == (None, "friction falls")


def test_a_limit_that_lies_behind_was_reached_in_the_past() -> None:
    found = fit_daily_friction_trend(week(0.2, noise_1=0.001), 1.1 * BASE_N_S_M)
    assert found.reached_d is not None
    assert found.reached_d == pytest.approx((3.0, 3.0), abs=0.3)


@pytest.mark.parametrize("days", [0, 1, 3])
def test_few_days_are_no_trend(days: int) -> None:
    found = fit_daily_friction_trend(week(0.1, days=days), 1.15 * BASE_N_S_M)
    assert found.reached_d is None
    assert found.why_not == f"{days} of at least 4 shifts on different days"
