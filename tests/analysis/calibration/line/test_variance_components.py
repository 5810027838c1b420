"""Variances of random effects by restricted maximum likelihood."""

import numpy as np
import pytest

from analysis.calibration.line.line_model import (
    DAY,
    REPEATABILITY,
    RUN,
    RunMeans,
    fit_line_and_variances,
    make_mean_square_to_variance_matrix,
)
from analysis.calibration.line.variance_components import (
    WithinRunVariance,
    estimate_variances_by_reml,
)


def balanced(dice, days=4, runs=6, readings=5, deviations=(20.0, 8.0, 12.0)):
    """Readings (days, runs, readings) about a mean that is the same everywhere."""
    rep, run, day = deviations
    return (
        dice.normal(0.0, day, (days, 1, 1))
        + dice.normal(0.0, run, (days, runs, 1))
        + dice.normal(0.0, rep, (days, runs, readings))
    )


def points_of(y):
    days, runs, readings = y.shape
    return RunMeans(
        y_kg=y.mean(2).ravel(),
        readings=np.full(days * runs, readings),
        load=np.tile(np.arange(runs), days),
        day=np.repeat(np.arange(days), runs),
        reference_kg=np.arange(runs) * 50.0,
        covariance_kg2=np.zeros((runs, runs)),
        within=WithinRunVariance(
            float(((y - y.mean(2, keepdims=True)) ** 2).sum()), days * runs * 4
        ),
    )


@pytest.mark.parametrize("seed", range(5))
def test_balanced_readings_have_the_variances_of_an_analysis_of_variance(seed):
    y = balanced(np.random.default_rng(seed))
    points, names = points_of(y), (REPEATABILITY, RUN, DAY)
    effects = np.array([points.make_effect_covariance(name) for name in names])
    squares = make_mean_square_to_variance_matrix(points, names)
    found = estimate_variances_by_reml(
        points.y_kg,
        np.ones((24, 1)),
        np.tensordot(squares.T, effects, 1),
        np.zeros((24, 24)),
        points.within,
    ).propagate_to_linear_combinations(squares)
    within = points.within.squares / 96
    means = y.mean(2)
    of_runs = ((means - means.mean(1, keepdims=True)) ** 2).sum() / 20
    of_days = 6 * means.mean(1).var(ddof=1)
    anova = np.array([within, of_runs - within / 5, (of_days - of_runs) / 6])
    assert found.value == pytest.approx(anova, rel=1e-5, abs=1e-5)
    # var(MS) = 2 MS² / freedom
    run_variance = 2 * of_runs**2 / 20 + 2 * within**2 / 96 / 25
    assert found.covariance[1, 1] == pytest.approx(run_variance, rel=1e-4)
    # a mean square of 20 degrees of freedom has these, made of the two that it is the sum of
    assert found.compute_satterthwaite_degrees_of_freedom(
        np.array([0.2, 1.0, 0.0]), of_runs
    ) == pytest.approx(20.0, rel=1e-4)


@pytest.mark.heavy
def test_variances_are_those_that_were_drawn_on_the_average():
    dice = np.random.default_rng(1)
    found = []
    for _ in range(400):
        points = points_of(balanced(dice))
        line = fit_line_and_variances(points)
        found.append([effect.variance_kg2 for effect in line.effects[:3]])
    mean = np.mean(found, axis=0)
    error = np.std(found, axis=0) / 20.0
    assert (np.abs(mean - np.array([400.0, 64.0, 144.0])) < 4.0 * error).all()


def test_unbalanced_readings_settle():
    dice = np.random.default_rng(3)
    readings = np.array([1, 9, 2, 5, 3, 4, 7, 2])
    points = RunMeans(
        y_kg=np.arange(8) * 50.0 + dice.normal(0.0, 20.0 / np.sqrt(readings)),
        readings=readings,
        load=np.arange(8),
        day=np.array([0, 0, 0, 0, 0, 1, 1, 2]),
        reference_kg=np.arange(8) * 50.0,
        covariance_kg2=np.eye(8),
        within=WithinRunVariance(400.0 * 25, 25),
    )
    line = fit_line_and_variances(points)
    assert np.linalg.eigvalsh(line.point_covariance_kg2).min() > 0.0
    assert line.slope_1 == pytest.approx(1.0, abs=0.1)
