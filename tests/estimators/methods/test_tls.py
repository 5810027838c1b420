"""Total least squares against the singular value decomposition of the scaled window."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.methods import ls, tls


def noisy_window(seed, n=200, noise_a=0.05, noise_v=0.02, noise_f=60.0, mass=3614.0):
    generator = np.random.default_rng(seed)
    t = np.linspace(0, 6, n)
    a, v = np.cos(t) + 0.3 * np.sin(3 * t), np.sin(t) + 1.0
    f = mass * a + 2891.0 * v
    A = np.column_stack(
        [a + noise_a * generator.normal(size=n), v + noise_v * generator.normal(size=n)]
    )
    return A, f + noise_f * generator.normal(size=n)


def last(n):
    return np.arange(n) == n - 1


@settings(deadline=None, max_examples=50)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(1e-3, 0.3),
    st.floats(1e-3, 0.3),
    st.floats(1.0, 1000.0),
)
def test_the_fast_form_is_the_smallest_singular_direction(seed, noise_a, noise_v, noise_f):
    A, f = noisy_window(seed)
    options = tls.TlsOptions((noise_a, noise_v), noise_f)
    scale = np.array([noise_a, noise_v, noise_f])
    smallest = np.linalg.svd(np.column_stack([A, f]) / scale)[2][-1]
    theta = -smallest[:2] / scale[:2] / (smallest[2] / scale[2])
    traced = tls.estimate_along_log(A, f, f.size, last(f.size), options)
    np.testing.assert_allclose(traced.theta[0], theta, rtol=1e-6)


def test_noise_in_the_regressor_biases_ls_and_not_tls():
    options = tls.TlsOptions((0.2, 0.1), 60.0)
    masses = np.array(
        [
            (ls.fit(A, f).theta[0], tls.fit(A, f, options).theta[0])
            for A, f in (noisy_window(seed, noise_a=0.2, noise_v=0.1) for seed in range(60))
        ]
    )
    bias_ls, bias_tls = masses.mean(axis=0) - 3614.0
    spread = masses[:, 1].std() / np.sqrt(60)
    assert bias_ls < -150.0
    assert abs(bias_tls) < 4 * spread


def test_only_the_ratios_of_the_noises_matter():
    A, f = noisy_window(1)
    one = tls.fit(A, f, tls.TlsOptions((0.01, 0.005), 60.0))
    ten = tls.fit(A, f, tls.TlsOptions((0.1, 0.05), 600.0))
    np.testing.assert_allclose(one.theta, ten.theta, rtol=1e-9)


def test_the_units_of_the_columns_do_not_matter():
    A, f = noisy_window(2)
    metric = tls.fit(A, f, tls.TlsOptions((0.05, 0.02), 60.0))
    other = tls.fit(A * [1e3, 1e-3], f, tls.TlsOptions((50.0, 2e-5), 60.0))
    np.testing.assert_allclose(other.theta, metric.theta * [1e-3, 1e3], rtol=1e-9)


@pytest.mark.parametrize("form", ["readable", "fast"])
def test_motion_no_larger_than_its_noise_gives_no_answer(form):
    generator = np.random.default_rng(3)
    A = 0.01 * generator.normal(size=(100, 2))
    f = 60.0 * generator.normal(size=100)
    A[:, 1] = A[:, 0] * (1 + 1e-9)
    options = tls.TlsOptions((0.05, 0.02), 60.0)
    if form == "readable":
        one = tls.fit(A, f, options)
        theta, std = one.theta, one.std
    else:
        traced = tls.estimate_along_log(A, f, 100, last(100), options)
        theta, std = traced.theta[0], traced.std[0]
    assert np.isnan(theta).all()
    assert np.isnan(std).all()
