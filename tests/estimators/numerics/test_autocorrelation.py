"""The residuals' correlation is told by the groups of these residuals, and by no others."""

import numpy as np
import pytest

from estimators.joint.prior_fit import Solution, solve_with_priors
from estimators.numerics.autocorrelation import estimate_pooled_autocorrelation

SAMPLES = 40
GROUP = np.repeat([-1, 0, 1], SAMPLES)


def solution(rows: int) -> Solution:
    """A fit of the first rows of a line with noise."""
    generator = np.random.default_rng(1)
    A = generator.normal(size=(GROUP.size, 2))[:rows]
    f = A @ [3.0, 1.0] + generator.normal(size=GROUP.size)[:rows]
    return solve_with_priors(A, f, GROUP[:rows], None, np.zeros(2), np.full(2, np.inf))


@pytest.mark.parametrize("rows", [GROUP.size, SAMPLES + 2])
def test_a_solution_has_the_group_of_each_residual(rows: int) -> None:
    """Also one that its two samples do not determine."""
    found = solution(rows)
    assert found.group.tolist() == GROUP[:rows].tolist()
    assert found.residual.size == rows
    assert np.isfinite(found.theta).all() == (rows == GROUP.size)


@pytest.mark.parametrize("groups", [GROUP.size - 1, GROUP.size + 1])
def test_groups_of_other_residuals_are_refused(groups: int) -> None:
    with pytest.raises(ValueError, match=f"120 residuals, but {groups} group numbers"):
        estimate_pooled_autocorrelation(np.ones(GROUP.size), np.zeros(groups, np.int64), None)
