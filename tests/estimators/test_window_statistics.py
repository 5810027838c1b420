"""What the gate asks of a window, against the formulas on paper."""

import numpy as np
import pytest

from estimators.methods import ls

WINDOW = 60
COVARIANCE = np.array([[0.04, 0.01, 0.5], [0.01, 0.03, 0.0], [0.5, 0.0, 25.0]])


def noisy(seed=3, n=400):
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(n, 2)) @ [[1.0, 0.9], [0.0, 0.3]]
    return A, A @ [100.0, 20.0] + generator.normal(size=n)


@pytest.mark.parametrize("noise", [None, COVARIANCE, 0.0 * COVARIANCE])
def test_each_number_is_its_formula(noise):
    A, f = noisy()
    index = np.arange(WINDOW - 1, f.size)
    seen = ls.compute_window_statistics(A, f, WINDOW, index, noise)
    for row, k in enumerate(index):
        part, force = A[k - WINDOW + 1 : k + 1], f[k - WINDOW + 1 : k + 1]
        bread = np.linalg.inv(part.T @ part)
        theta = bread @ part.T @ force
        variance = ((force - part @ theta) ** 2).sum() / (WINDOW - 2)
        # what is left of the first column beside the second
        beside = part[:, 1] @ part[:, 0] / (part[:, 1] @ part[:, 1])
        left = ((part[:, 0] - beside * part[:, 1]) ** 2).sum()
        share = 0.0
        if noise is not None:
            e = np.append(-theta, 1.0)
            variance = max(variance, e @ noise @ e)
            c = np.array([1.0, -beside])
            share = WINDOW * (c @ noise[:2, :2] @ c) / left
        assert seen.partial[row] == pytest.approx(left, rel=1e-9)
        assert seen.noise_share[row] == pytest.approx(share, rel=1e-9)
        assert seen.predicted[row] == pytest.approx(np.sqrt(variance * bread[0, 0]), rel=1e-9)


def test_the_share_of_noise_is_what_noise_draws_the_first_parameter_by():
    """LS finds θ₁ times one less the share, where the second parameter takes up the rest."""
    generator = np.random.default_rng(5)
    n, covariance = 40_000, np.diag([0.02, 0.0, 0.0])
    clean = generator.normal(size=(n, 2)) @ [[0.3, 1.0], [0.0, 0.2]]
    A = clean + generator.normal(size=(n, 2)) * np.sqrt(np.diag(covariance)[:2])
    f = clean @ [100.0, 20.0]
    seen = ls.compute_window_statistics(A, f, n, np.array([n - 1]), covariance)
    assert 0.05 < seen.noise_share[0] < 0.95
    found = ls.fit(A, f).theta[0]
    assert found == pytest.approx(100.0 * (1.0 - seen.noise_share[0]), rel=0.05)
