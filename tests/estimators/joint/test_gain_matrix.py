"""Levels eliminated one by one: the same fit as by dense matrices."""

from dataclasses import replace

import numpy as np
import pytest

from estimators.joint import gain_matrix
from estimators.joint.joint_limits import LIMITS
from estimators.joint.posterior_fit import PosteriorFit
from estimators.joint.prior_fit import Grouping, fit
from estimators.joint.random_intercepts import RandomIntercepts
from estimators.numerics.bordered_matrix import BorderedMatrix
from estimators.numerics.group_sums import NoiseMoments

LEVELS, SAMPLES = 70, 60
NOISE_M_S2 = 0.02


def fitted(seed: int, *, noisy: bool, shape: tuple[float, ...]) -> PosteriorFit:
    """A fit of starts at a level each or two, that scatter about it, with terms under priors."""
    dice = np.random.default_rng(seed)
    starts = LEVELS + 15
    level = np.sort(np.append(np.arange(LEVELS), dice.integers(0, LEVELS, 15)))
    group = np.repeat(np.arange(starts), SAMPLES)
    t = np.tile(np.linspace(0.0, 3.0, SAMPLES), starts)
    strength = np.repeat(dice.uniform(0.5, 1.0, starts), SAMPLES)
    A = np.column_stack(
        [1.5 * strength * np.exp(-t), 1.5 * strength * (1.0 - np.exp(-t)), np.ones(t.size), t]
    )
    mass = np.repeat(3600.0 + 300.0 * (level % 2) + dice.normal(0.0, 10.0, starts), SAMPLES)
    f = A[:, 0] * mass + A[:, 1:] @ np.array([2900.0, 50.0, -20.0])
    f = f + np.convolve(dice.normal(0.0, 60.0, f.size), shape, "same")
    moments = None
    if noisy:
        A[:, 0] += dice.normal(0.0, NOISE_M_S2, f.size)
        gram = np.zeros((starts, 4, 4))
        gram[:, 0, 0] = SAMPLES * NOISE_M_S2**2
        moments = NoiseMoments(gram, np.zeros((starts, 4)))
    believed = np.zeros(4), np.array([np.inf, np.inf, 100.0, 50.0])
    grouping = Grouping(levels=RandomIntercepts(level, np.arange(starts), 12.0, 15.0))
    return fit(A, f, group, moments, *believed, grouping)


def near(found: np.ndarray, wanted: np.ndarray) -> bool:
    """Equal to 1e-7 of the largest."""
    return bool(np.abs(found - wanted).max() <= 1e-7 * max(np.abs(wanted).max(), 1e-300))


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize(
    "shape", [(1.0,), (0.5, 0.8, 0.5), (1.0, -1.0)], ids=["white", "lasting", "alternating"]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_fit_of_many_levels_is_that_by_dense_matrices(
    seed: int, shape: tuple[float, ...], monkeypatch: pytest.MonkeyPatch, *, noisy: bool
) -> None:
    found = fitted(seed, noisy=noisy, shape=shape)
    monkeypatch.setattr(gain_matrix, "LIMITS", replace(LIMITS, eliminated_levels=10_000))
    dense = fitted(seed, noisy=noisy, shape=shape)
    for name in ("theta", "noise", "responses", "scatter", "misfit", "doubt"):
        assert near(getattr(found, name), getattr(dense, name)), name
    assert found.scatter_ratio == pytest.approx(dense.scatter_ratio, rel=1e-7)
    assert found.misfit_ratio == pytest.approx(dense.misfit_ratio, rel=1e-7)
    assert near(found.covariance, dense.covariance)


def bordered(dice: np.random.Generator, least: float) -> BorderedMatrix:
    """A matrix of 30 levels and 4 shared parameters whose smallest eigenvalue is `least`."""
    right = dice.normal(size=(30, 4))
    corner = dice.normal(size=(4, 4))
    plain = BorderedMatrix(dice.uniform(1.0, 3.0, 30), right, right.T, corner + corner.T)
    more = least - np.linalg.eigvalsh(plain.to_dense())[0]
    return plain._replace(diagonal=plain.diagonal + more, corner=plain.corner + more * np.eye(4))


def test_a_bordered_matrix_multiplies_and_solves_as_its_dense_form() -> None:
    dice = np.random.default_rng(4)
    matrix = bordered(dice, 0.5)
    columns = dice.normal(size=(34, 3))
    np.testing.assert_allclose(matrix.multiply(columns), matrix.to_dense() @ columns)
    np.testing.assert_allclose(
        matrix.solve(columns[:, 0]), np.linalg.solve(matrix.to_dense(), columns[:, 0])
    )
    assert matrix.trace == pytest.approx(np.trace(matrix.to_dense()))
    with pytest.raises(np.linalg.LinAlgError, match="without samples"):
        matrix._replace(diagonal=0.0 * matrix.diagonal).solve(columns[:, 0])


@pytest.mark.parametrize("least", [-0.05, 0.05])
def test_a_direction_below_the_fraction_of_another_is_seen(least: float) -> None:
    dice = np.random.default_rng(5)
    other = bordered(dice, 1.0)
    more = bordered(dice, least)
    parts = zip(more, other, strict=True)
    matrix = BorderedMatrix(*(extra + 0.1 * part for extra, part in parts))
    assert matrix.dominates_fraction_of(other, 0.1, 1e-12) == (least > 0.0)
