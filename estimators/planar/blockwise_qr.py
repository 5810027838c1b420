"""QR of a tall regressor in blocks: triangular factors, and the sandwich of the residuals.

A shift at 100 Hz has millions of rows, of which least squares needs a single pass: R of
[R; next rows] is the R of all rows (TSQR), and R gives every product and, to rounding, every
singular value.
"""

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.numerics.sandwich import compute_sandwich_meat

#: Number of rows processed at a time.
BLOCK = 16_384


class Blocks(Protocol):
    """A regressor (n, k, p) of k axes, built a slice of samples at a time; arrays qualify too."""

    @property
    def shape(self) -> tuple[int, ...]:
        """n, k, p."""
        ...

    def __getitem__(self, part: slice, /) -> Floats:
        """The samples of a slice, (m, k, p)."""
        ...


def iter_used_blocks(is_used: Bools) -> Iterator[slice]:
    """Slices that together contain every used sample."""
    for first in range(0, is_used.size, BLOCK):
        part = slice(first, min(first + BLOCK, is_used.size))
        if is_used[part].any():
            yield part


def compute_triangular_factors(A: Blocks, f: Floats, is_used: Bools) -> Floats:
    """Triangular factor of [A f] of each axis, (k, p + 1, p + 1), over the used samples.

    Args:
        A: (n, k, p) regressor.
        f: (n, k) force or torque.
        is_used: (n,) whether to use each sample; others may be NaN.
    """
    _, k, p = A.shape
    out = np.zeros((k, p + 1, p + 1))
    for part in iter_used_blocks(is_used):
        both = np.concatenate([A[part], f[part][..., None]], axis=-1)[is_used[part]]
        for axis in range(k):
            rows = np.concatenate([out[axis], both[:, axis]])
            out[axis] = np.linalg.qr(rows, mode="r")
    return out


def compute_blockwise_residuals(A: Blocks, f: Floats, is_used: Bools, theta: Floats) -> Floats:
    """Residuals f - A θ, (n, k), zero where not used; θ is (p,)."""
    out = np.zeros(f.shape)
    for part in iter_used_blocks(is_used):
        out[part] = np.where(is_used[part][:, None], f[part] - A[part] @ theta, 0.0)
    return out


def sum_sandwich_meat(
    A: Blocks,
    columns: Ints,
    stretch_of_sample: Ints,
    correlations: list[Floats],
    axis_weights: Floats,
) -> Floats:
    """Σ w² Aᵀ R A over axes and stretches, (r, r); each axis' stretch is its own series.

    Args:
        A: (n, k, p) regressor.
        columns: (r,) selected columns.
        stretch_of_sample: (n,) stretch of each sample, negative for excluded ones.
        correlations: k of (lags,), the residuals' autocorrelation of each axis.
        axis_weights: (k, r) factors of each axis' columns.
    """
    total = np.zeros((columns.size, columns.size))
    before = max(each.size for each in correlations) - 1
    for part in iter_used_blocks(stretch_of_sample >= 0):
        # include the preceding samples that the first ones of the block are correlated with
        history = min(before, part.start)
        wide = slice(part.start - history, part.stop)
        rows, labels = A[wide][..., columns], stretch_of_sample[wide]
        for axis, correlation in enumerate(correlations):
            scaled = np.ascontiguousarray(rows[:, axis]) * axis_weights[axis]
            for label in np.unique(labels[history:]):
                if label >= 0:
                    own = labels[history:] == label
                    first = history + int(own.argmax())
                    last = labels.size - 1 - int(own[::-1].argmax())
                    total += compute_sandwich_meat(scaled, labels, label, first, last, correlation)
    return total
