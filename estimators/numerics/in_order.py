"""Sums and products with a defined order of operations, for interpreted and compiled loops.

Compiled sums add from the first term to the last, while numpy sums pairwise; products of vectors
use SciPy's BLAS, while numpy has its own library.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from estimators.arrays import Floats
from estimators.interpreted import Primitive


def sum_axis_in_order(x: Floats, axis: int) -> Floats:
    """Sum along an axis, from the first term to the last."""
    zero = np.zeros_like(x, shape=[1 if k == axis else size for k, size in enumerate(x.shape)])
    return np.asarray(np.cumsum(np.concatenate([zero, x], axis), axis).take(-1, axis))


def _sum_by_numpy(x: Floats) -> float:
    return float(sum_axis_in_order(x, 0))


def _dot_by_scipy(x: Floats, y: Floats) -> float:
    from scipy.linalg.blas import ddot  # slow to import

    return float(cast("Any", ddot)(x, y)) if x.size else 0.0


def _sum_in_order(x: Floats) -> float:
    return x.sum()


def _dot_in_order(x: Floats, y: Floats) -> float:
    return float(x @ y)


def _make_ordered_sum_primitive(
    library_call: Callable[..., Any], compiled_loop: Callable[..., Any]
) -> Any:
    """Make a sum in order: a library call when interpreted, a loop when compiled."""

    def import_and_compile() -> Any:
        from estimators.compiled import compiled  # imports numba, which is slow

        return compiled(compiled_loop)

    return Primitive(library_call, import_and_compile)


#: Σ x of a vector
sum_in_order = cast(
    "Callable[[Floats], float]", _make_ordered_sum_primitive(_sum_by_numpy, _sum_in_order)
)
#: Σ x y of two vectors, each without gaps
multiply_vectors = cast(
    "Callable[[Floats, Floats], float]", _make_ordered_sum_primitive(_dot_by_scipy, _dot_in_order)
)
