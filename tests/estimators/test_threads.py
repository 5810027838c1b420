"""Sums of long vectors do not depend on the number of cores."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from estimators.threads import limit_blas_to_one_thread


def blas_threads() -> set[int]:
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


def test_inside_blas_has_one_thread_and_outside_as_many_as_before() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = blas_threads()
        with limit_blas_to_one_thread(), limit_blas_to_one_thread():
            assert blas_threads() == {1}
        assert blas_threads() == before == {2}
        with pytest.raises(RuntimeError), limit_blas_to_one_thread():
            raise RuntimeError
        assert blas_threads() == before


def test_a_long_sum_has_the_same_bits_on_any_number_of_threads() -> None:
    x, y = np.random.default_rng(1).normal(size=(2, 200_001))
    sums = set()
    for threads in (1, 2):
        with threadpool_limits(limits=threads, user_api="blas"), limit_blas_to_one_thread():
            sums.add(float(x @ y))
    assert len(sums) == 1
