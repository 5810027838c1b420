"""Windows are weighed anew in batches: a full batch gives what each of its windows gives alone."""

import numpy as np
import pytest

from estimators.methods import fgls, huber
from estimators.numerics.reweighted import AT_ONCE
from tests.twins import mark_heavy_after


@pytest.mark.heavy
@pytest.mark.parametrize("method", mark_heavy_after(1, [huber, fgls]), ids=["huber", "fgls"])
def test_every_window_of_full_batches_is_that_of_the_window_alone(method):
    generator = np.random.default_rng(8)
    window, windows = 30, 2 * AT_ONCE + 3
    A = generator.normal(size=(window + windows - 1, 2)) + 0.5
    f = A @ [3614.0, 2891.0] + 60.0 * generator.standard_t(2, size=len(A))
    traced = method.estimate_along_log(A, f, window, np.arange(len(A)) >= window - 1)
    assert traced.index.size == windows
    for row, last in enumerate(traced.index):
        one = method.fit(A[last - window + 1 : last + 1], f[last - window + 1 : last + 1])
        np.testing.assert_allclose(traced.theta[row], one.theta, rtol=1e-9, err_msg=str(row))
