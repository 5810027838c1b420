"""Normal equations by group of samples, and the contribution of column noise to them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.fit_loss import list_rows_by_group
from estimators.numerics.group_mean import iter_group_runs
from estimators.numerics.in_order import sum_axis_in_order
from estimators.numerics.small_systems import NOTHING


@dataclass(frozen=True, slots=True)
class NoiseMoments:
    """Noise terms of the normal equations, by group in ascending order.

    Attributes:
        gram: (groups, p, p) noise contribution to AᵀA.
        cross: (groups, p) noise contribution to Aᵀf, from noise shared with the response.
    """

    gram: Floats
    cross: Floats


def _sum_noise_moments_vectorised(
    slopes: Floats,
    column_and_channel: Ints,
    covariances: Floats,
    sample_kinds: Ints,
    group: Ints,
    output_shape: tuple[int, int],
) -> tuple[Floats, Floats]:
    groups, p = output_shape
    gram, cross = np.zeros((groups, p, p)), np.zeros((groups, p))
    s, t = np.tril_indices(len(slopes))
    column, channel = column_and_channel.T
    pairs = covariances[:, channel[s], channel[t]][sample_kinds].T
    squares = slopes[s] * slopes[t] * pairs
    singles = slopes * covariances[:, channel, -1][sample_kinds].T
    for first, end in iter_group_runs(group):
        g = group[first]
        np.add.at(cross[g], column, sum_axis_in_order(singles[:, first:end], 1))
        totals = sum_axis_in_order(squares[:, first:end], 1)
        for i, j, total, on_diagonal in zip(column[s], column[t], totals, s == t, strict=True):
            gram[g, i, j] += total
            if not on_diagonal:
                gram[g, j, i] += total
    return gram, cross


@compiled_with_array_form(_sum_noise_moments_vectorised)
def sum_noise_moments(
    slopes: Floats,
    column_and_channel: Ints,
    covariances: Floats,
    sample_kinds: Ints,
    group: Ints,
    output_shape: tuple[int, int],
) -> tuple[Floats, Floats]:
    """Sum the contribution of channel noise to the normal equations.

    Args:
        slopes: (slopes, n) nonzero derivatives of columns with respect to channels.
        column_and_channel: (slopes, 2) column and channel of each slope; the last channel is the
            response.
        covariances: (kinds, channels, channels) noise covariances of the channels.
        sample_kinds: (n,) kind of each sample.
        group: (n,) group of each sample, from 0.
        output_shape: number of groups and columns.

    Returns:
        (groups, p, p) and (groups, p): see `NoiseMoments`.
    """
    groups, p = output_shape
    gram, cross = np.zeros((groups, p, p)), np.zeros((groups, p))
    count, n = slopes.shape
    kinds, response = covariances.shape[0], covariances.shape[1] - 1
    # pairs of slopes, counted in both orders, and of each slope with the response
    pairs = np.empty((kinds, count * (count + 1) // 2))
    own = np.empty((kinds, count))
    for kind in range(kinds):
        pair = 0
        for s in range(count):
            own[kind, s] = covariances[kind, column_and_channel[s, 1], response]
            for t in range(s + 1):
                pairs[kind, pair] = covariances[
                    kind, column_and_channel[s, 1], column_and_channel[t, 1]
                ]
                pair += 1
    squares, singles, here = np.zeros(pairs.shape[1]), np.zeros(count), np.empty(count)
    for k in range(n):
        by_pair, by_slope = pairs[sample_kinds[k]], own[sample_kinds[k]]
        for s in range(count):
            here[s] = slopes[s, k]
        pair = 0
        for s in range(count):
            mine = here[s]
            singles[s] += mine * by_slope[s]
            for t in range(s + 1):
                squares[pair + t] += mine * here[t] * by_pair[pair + t]
            pair += s + 1
        if k == n - 1 or group[k + 1] != group[k]:
            g = group[k]
            pair = 0
            for s in range(count):
                i = column_and_channel[s, 0]
                cross[g, i] += singles[s]
                singles[s] = 0.0
                for t in range(s + 1):
                    j = column_and_channel[t, 0]
                    gram[g, i, j] += squares[pair]
                    if s != t:
                        gram[g, j, i] += squares[pair]
                    squares[pair] = 0.0
                    pair += 1
    return gram, cross


def compute_rms_scales_of_columns(A: Floats, group: Ints) -> Floats:
    """Divisors (p,) that give the columns a mean square of 1.

    They are applied to sums instead of the columns, which would have to be copied.

    Args:
        A: (n, p) columns.
        group: (n,) group of each sample, negative for none.

    Returns:
        The divisors; 1 for a column that is 0 except for rounding, whose parameter keeps its prior.
    """
    scale = np.sqrt(_sum_squares(A, group) / max(int((group >= 0).sum()), 1))
    return np.where(scale**2 > NOTHING, scale, 1.0)


def _sum_squares_vectorised(A: Floats, group: Ints) -> Floats:
    return sum_axis_in_order(np.where(group[:, None] >= 0, A * A, 0.0), 0)


@compiled_with_array_form(_sum_squares_vectorised)
def _sum_squares(A: Floats, group: Ints) -> Floats:
    total = np.zeros(A.shape[1])
    for k in range(A.shape[0]):
        if group[k] >= 0:
            for i in range(A.shape[1]):
                total[i] += A[k, i] * A[k, i]
    return total


@dataclass(frozen=True, slots=True)
class GroupSums:
    """Normal equations by group, in ascending order.

    Attributes:
        rows: samples of each group.
        grams: (groups, p, p) AᵀA.
        crosses: (groups, p) Aᵀf.
        noise_gram: (groups, p, p) noise contribution to `grams`.
        noise_cross: (groups, p) noise contribution to `crosses`.
    """

    rows: list[Ints]
    grams: Floats
    crosses: Floats
    noise_gram: Floats
    noise_cross: Floats

    @classmethod
    def sum_products_by_group(
        cls, A: Floats, f: Floats, group: Ints, noise: NoiseMoments | None, scale: Floats
    ) -> Self:
        """Sum the products of the columns, divided by (p,) `scale`, by group."""
        rows, square = list_rows_by_group(group), np.outer(scale, scale)
        grams, crosses = np.empty((len(rows), *square.shape)), np.empty((len(rows), scale.size))
        for number, part in enumerate(map(convert_consecutive_rows_to_slice, rows)):
            # both while the group's columns are in the cache
            grams[number], crosses[number] = A[part].T @ A[part], A[part].T @ f[part]
        grams, crosses = grams / square, crosses / scale
        if noise is None:
            return cls(rows, grams, crosses, np.zeros_like(grams), np.zeros_like(crosses))
        return cls(rows, grams, crosses, noise.gram / square, noise.cross / scale)

    def sum_groups_by_unit(self, unit_of_group: Ints) -> Self:
        """Sum over the groups of each unit, (groups,) from 0; `rows` stay by group."""
        if np.array_equal(unit_of_group, np.arange(len(self.rows))):
            return self

        units = int(unit_of_group.max()) + 1
        return type(self)(
            self.rows,
            sum_matrices_by_unit(self.grams, unit_of_group, units),
            sum_matrices_by_unit(self.crosses[:, None], unit_of_group, units)[:, 0],
            sum_matrices_by_unit(self.noise_gram, unit_of_group, units),
            sum_matrices_by_unit(self.noise_cross[:, None], unit_of_group, units)[:, 0],
        )


@compiled_unless_short_log
def sum_matrices_by_unit(values: Floats, unit_of_group: Ints, unit_count: int) -> Floats:
    """Sum (groups, q, p) over the groups of each unit, in their order: (units, q, p)."""
    groups, q, p = values.shape
    out = np.zeros((unit_count, q, p))
    for g in range(groups):
        for i in range(q):
            for j in range(p):
                out[unit_of_group[g], i, j] += values[g, i, j]
    return out


def convert_consecutive_rows_to_slice(rows: Ints) -> slice | Ints:
    """Rows as a slice if consecutive, so that indexing makes no copy."""
    first, last = int(rows[0]), int(rows[-1]) + 1
    return slice(first, last) if last - first == rows.size else rows


def fit_slope_of_each_group(regressor: Floats, group: Ints, response: Floats) -> Floats:
    """Slope through the origin of each group, (groups,); 0 where its regressor is 0.

    Args:
        regressor: (n,) the regressor.
        group: (n,) group of each sample, from 0.
        response: (n,) the quantity to be explained.
    """
    square = np.bincount(group, regressor**2)
    return np.bincount(group, regressor * response) / np.where(square > 0.0, square, 1.0)
