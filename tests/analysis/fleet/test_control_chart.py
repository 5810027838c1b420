"""Control charts: false alarms as rare as stated, drifts found, whatever the machine is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.fleet.fleet_limits import LIMITS
from analysis.fleet.machine_drifts import (
    compute_cusum_average_run_length,
    find_cusum_limit,
    make_control_chart,
    remove_lag_1_correlation,
    standardise_innovations,
)

FINITE = st.floats(-1e3, 1e3)


@pytest.mark.parametrize(
    ("limit", "run_length"),
    [(8.01, 370.0), (11.0, 1817.0)],
)
def test_the_run_length_is_that_of_the_literature(limit: float, run_length: float) -> None:
    """Of both sums together, with the allowance ¼ (Montgomery, Statistical Quality Control)."""
    if limit == 8.01:
        assert LIMITS.cusum_allowance_std == 0.25
        assert compute_cusum_average_run_length(limit) / 2.0 == pytest.approx(run_length, rel=0.01)
    else:
        # Siegmund's approximation
        b = limit + 1.166
        known = (np.exp(0.5 * b) - 0.5 * b - 1.0) / (2.0 * LIMITS.cusum_allowance_std**2)
        assert compute_cusum_average_run_length(limit) == pytest.approx(known, rel=0.02)


def test_the_limit_has_the_run_length_that_was_asked_for() -> None:
    for run_length in (100.0, 1000.0, 3000.0):
        assert compute_cusum_average_run_length(find_cusum_limit(run_length)) == pytest.approx(
            2.0 * run_length, rel=0.01
        )


def test_a_simulated_run_length_is_the_computed_one() -> None:
    """Of the sums over normal values: a Markov chain against counting."""
    draw = np.random.default_rng(11)
    limit, lengths = 4.0, []
    for _ in range(1500):
        total, n = 0.0, 0
        while total <= limit:
            total = max(total + draw.normal() - LIMITS.cusum_allowance_std, 0.0)
            n += 1
        lengths.append(n)
    assert np.mean(lengths) == pytest.approx(compute_cusum_average_run_length(limit), rel=0.1)


def test_innovations_are_standard_normal_from_the_third_value_on() -> None:
    draw = np.random.default_rng(3)
    found = np.array([standardise_innovations(draw.normal(3600.0, 12.0, 12)) for _ in range(4000)])
    assert np.all(found[:, :2] == 0.0)
    for n in range(3, 12):
        assert abs(found[:, n].mean()) < 0.06
        assert found[:, n].std() == pytest.approx(1.0, abs=0.05)


@pytest.mark.heavy
@given(st.lists(FINITE, min_size=25, max_size=60), FINITE, st.floats(0.01, 1e3))
def test_a_chart_depends_on_neither_unit_nor_zero(
    values: list[float], offset: float, unit: float
) -> None:
    x = np.array(values)
    x = x + np.random.default_rng(1).normal(0.0, 1.0, x.size)
    a, b = make_control_chart(x, 5.0), make_control_chart(offset + unit * x, 5.0)
    np.testing.assert_allclose(a.innovation, b.innovation, atol=1e-4)
    np.testing.assert_allclose(a.cusum_up, b.cusum_up, atol=1e-2)


@given(st.lists(FINITE, max_size=30))
def test_a_chart_of_anything_has_a_sum_a_value_and_none_below_zero(values: list[float]) -> None:
    chart = make_control_chart(np.array(values), 5.0)
    assert chart.cusum_up.size == chart.cusum_down.size == len(values)
    assert np.all(chart.cusum_up >= 0.0)
    assert np.all(chart.cusum_down >= 0.0)
    assert np.isfinite(chart.innovation).all()


def test_a_constant_flags_nothing() -> None:
    assert make_control_chart(np.full(300, 7.0), 5.0).flagged_index is None


def test_a_jump_is_flagged_where_it_begins_with_its_size() -> None:
    draw = np.random.default_rng(4)
    x = draw.normal(3600.0, 5.0, 200)
    x[120:] += 15.0
    chart = make_control_chart(x, find_cusum_limit(2190.0))
    assert chart.flagged_index is not None
    assert chart.first_shifted_index is not None
    assert 120 <= chart.flagged_index < 132
    # the stretch may begin where the sum last was 0, somewhat early
    assert 80 <= chart.first_shifted_index <= 122
    assert chart.change == pytest.approx(15.0, abs=4.0 * chart.change_std)


def test_one_day_with_a_broken_log_is_no_drift() -> None:
    x = np.random.default_rng(5).normal(3600.0, 5.0, 200)
    x[100] += 2000.0
    assert make_control_chart(x, find_cusum_limit(2190.0)).flagged_index is None


def test_days_that_are_alike_in_a_row_are_told_from_a_drift() -> None:
    draw = np.random.default_rng(6)
    x = np.zeros(4000)
    for n in range(1, x.size):
        x[n] = 0.5 * x[n - 1] + draw.normal()
    left = remove_lag_1_correlation(x)
    assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.06
    # a drift alone does not look like it
    drifting = draw.normal(size=400) + np.arange(400) / 30.0
    np.testing.assert_allclose(
        remove_lag_1_correlation(drifting), drifting, atol=0.15 * np.abs(drifting).max()
    )
