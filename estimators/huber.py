"""Huber's robust regression over sliding windows: outliers pull with a bounded force.

Iteratively reweighted least squares, w = min(1, c / |r/s|), s = median|r| / 0.6745 of the first
OLS residuals (Huber 1964; Huber and Ronchetti 2009, 7.8). To first order the estimate is OLS of the
pseudo-residuals ψ(r) / mean ψ', so their sandwich is its standard deviation.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators import ls
from estimators.autocorrelation import pooled_autocorrelation, window_residuals
from estimators.compiled import compiled
from estimators.linear import at, condition_numbers, lstsq
from estimators.normal import normal_equations, residual_squares, solve_products, store
from estimators.reweighted import Reweighting, consecutive, residuals, reweigh, reweighting
from estimators.rolling import sample_products, sum_windows, window_ends, workspace
from estimators.sandwich import window_deviation, window_deviations
from estimators.trace import Bools, Estimate, Floats, Ints, Trace

#: Iterations converge linearly; more than this many change nothing that matters.
_MOST_STEPS = 100
_NEWTON_STEPS = 12
_SETTLED = 1e-12


@dataclass(frozen=True, slots=True)
class HuberOptions:
    """c: residuals up to c·s weigh fully; 1.345 keeps 95 % efficiency for Gaussian noise."""

    bend: float = 1.345


def fit(
    A: Floats,
    f: Floats,
    options: HuberOptions | None = None,
    autocorrelation: Floats | None = None,
) -> Estimate:
    """Estimate one window.

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: where the weights begin to fall.
        autocorrelation: (lags,) of the pseudo-residuals; from this window alone if not given.
    """
    options = options or HuberOptions()
    first = ls.fit(A, f, autocorrelation=autocorrelation)
    theta = first.theta
    limit = options.bend * float(np.median(np.abs(f - A @ theta))) / 0.6745
    if limit == 0.0:
        return first
    for _ in range(_MOST_STEPS):
        residual = f - A @ theta
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residual), limit)))
        following = lstsq(A * root[:, None], f * root)
        moved = np.abs(following - theta).max() / max(np.abs(following).max(), 1e-300)
        theta = following
        if moved < _SETTLED:
            break
    residual = f - A @ theta
    pseudo = np.clip(residual, -limit, limit) / (np.abs(residual) <= limit).mean()
    std = window_deviation(A, A.T @ A, pseudo, autocorrelation)
    return Estimate(theta, std, float(np.sqrt((residual**2).mean())), first.condition)


@compiled
def _solve_windows(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    bend: float,
    theta: Floats,
    grams: Floats,
    rss: Floats,
    condition: Floats,
    limit: Floats,
    kept: Floats,
    squares: Floats,
) -> None:
    """θ (rows, p), AᵀA (rows, entries) packed; the others, (rows,), as in `Robust`."""
    p = A.shape[1]
    work = workspace(p + 1, window)
    normal = normal_equations(p, window)
    room = robust(p, window)
    row = 0
    while row < index.size:
        end = sum_windows(A, f, window, index, row, work)
        m = end - row
        condition_numbers(work.products, p + 1, p, m, condition[row:end])
        solve_products(work.products, m, normal)
        solve_robust(work.z, window, index, row, end, bend, normal.x, room)
        residual_squares(work.products, room.theta, m, rss[row:end])
        store(room.theta, work.products, row, m, theta, grams)
        for k in range(m):
            limit[row + k] = room.limit[k]
            kept[row + k] = room.kept[k]
            squares[row + k] = room.squares[k]
        row = end


class Robust(NamedTuple):
    """Room to solve windows of p parameters in.

    Attributes:
        theta: (p, windows) estimates.
        limit: (windows,) residuals up to this weigh fully.
        kept: (windows,) mean ψ', the share of the samples that do.
        squares: (windows,) sums of squared pseudo-residuals.
        settled: (windows,) whether the estimate stands still.
        residual: (windows,) of one sample of each window, and
        sizes: (window,) of all samples of one window.
        pull: (windows,) what a sample pulls with.
        weighted: the normal equations of a step.
    """

    theta: Floats
    limit: Floats
    kept: Floats
    squares: Floats
    settled: Bools
    residual: Floats
    sizes: Floats
    pull: Floats
    weighted: Reweighting


@compiled
def robust(p: int, window: int) -> Robust:
    """Room for the windows of a pair of blocks."""
    return Robust(
        np.empty((p, window)),
        np.empty(window),
        np.empty(window),
        np.empty(window),
        np.empty(window, np.bool_),
        np.empty(window),
        np.empty(window),
        np.empty(window),
        reweighting(p, window),
    )


@compiled
def solve_robust(
    z: Floats,
    window: int,
    index: Ints,
    row: int,
    end: int,
    bend: float,
    start: Floats,
    room: Robust,
) -> None:
    """Solve windows row … end - 1 from their OLS estimates `start` (p, ≥ end - row).

    Huber's loss is quadratic between the samples' bends, so that Newton ends at its minimum
    exactly, mostly within five steps; a window where it does not is left to reweighting.
    """
    p, m = start.shape[0], end - row
    room.theta[:, :m] = start[:, :m]
    for i in range(m):
        offset = index[row + i] - index[row]
        for s in range(window):
            e = z[p, offset + s]
            for c in range(p):
                e -= z[c, offset + s] * start[c, i]
            room.sizes[s] = abs(e)
        room.limit[i] = bend * np.median(room.sizes) / 0.6745
        room.settled[i] = room.limit[i] == 0.0 or np.isnan(room.limit[i])
    for step in range(_NEWTON_STEPS + _MOST_STEPS):
        if room.settled[:m].all():
            break
        if step < _NEWTON_STEPS:
            _newton(z, window, index, row, end, room)
        else:
            weighted = room.weighted
            reweigh(z, window, index, row, end, room.limit, False, room.theta, weighted)
        _move(m, room)
    _pseudo_residuals(z, window, index, row, end, room)


@compiled
def _newton(z: Floats, window: int, index: Ints, row: int, end: int, room: Robust) -> None:
    """One step of Newton: full samples fit themselves, the others pull with the limit's force."""
    p, out = room.theta.shape[0], room.weighted
    sample_products(z, index[end - 1] - index[row] + window, out.raw)
    out.products[:, : end - row] = 0.0
    begin = row
    while begin < end:
        stop = consecutive(index, begin, end)
        offset, low, high = index[begin] - index[row], begin - row, stop - row
        full, pull, m = out.weight, room.pull, stop - begin
        limit = room.limit[low:high]
        for s in range(offset, offset + window):
            residuals(z, s, room.theta, low, high, pull)
            force = z[p, s : s + m]
            for k in range(m):
                inside = abs(pull[k]) <= limit[k]
                clipped = limit[k] if pull[k] > 0.0 else -limit[k]
                pull[k] = force[k] if inside else clipped
                full[k] = 1.0 if inside else 0.0
            for i in range(p):
                for j in range(i, p):
                    entry = at(i, j, p + 1)
                    total, product = out.products[entry, low:high], out.raw[entry, s : s + m]
                    for k in range(m):
                        total[k] += full[k] * product[k]
                total, column = out.products[at(i, p, p + 1), low:high], z[i, s : s + m]
                for k in range(m):
                    total[k] += pull[k] * column[k]
        begin = stop
    solve_products(out.products, end - row, out.normal)


@compiled
def _move(m: int, room: Robust) -> None:
    """Take the step where the estimate has not settled, and see whether it has now."""
    p, following = room.theta.shape[0], room.weighted.normal.x
    for k in range(m):
        moved, size, known = 0.0, 1e-300, True
        for c in range(p):
            moved = max(moved, abs(following[c, k] - room.theta[c, k]))
            size = max(size, abs(following[c, k]))
            known = known and not np.isnan(following[c, k])
        if not room.settled[k] and known:
            for c in range(p):
                room.theta[c, k] = following[c, k]
            room.settled[k] = moved < _SETTLED * size


@compiled
def _pseudo_residuals(
    z: Floats, window: int, index: Ints, row: int, end: int, room: Robust
) -> None:
    """Σ of squared pseudo-residuals ψ(r) / mean ψ', and mean ψ' itself, of each window."""
    room.squares[: end - row] = 0.0
    room.kept[: end - row] = 0.0
    begin = row
    while begin < end:
        stop = consecutive(index, begin, end)
        offset, low, high = index[begin] - index[row], begin - row, stop - row
        limit, kept = room.limit[low:high], room.kept[low:high]
        squares, e = room.squares[low:high], room.residual
        for s in range(offset, offset + window):
            residuals(z, s, room.theta, low, high, e)
            for k in range(stop - begin):
                size = abs(e[k])
                kept[k] += 1.0 if size <= limit[k] else 0.0
                size = size if size < limit[k] else limit[k]
                squares[k] += size * size
        begin = stop
    for k in range(end - row):
        # without a limit nothing is clipped
        share = room.kept[k] / window if room.limit[k] > 0.0 else 1.0
        room.kept[k] = share
        room.squares[k] /= share * share


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: HuberOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: where the weights begin to fall.
    """
    options = options or HuberOptions()
    index = window_ends(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    rows = index.size
    theta, grams = np.empty((rows, p)), np.empty((rows, p * (p + 1) // 2))
    rss, condition, limit, kept, squares = (np.empty(rows) for _ in range(5))
    _solve_windows(
        A, f, window, index, options.bend, theta, grams, rss, condition, limit, kept, squares
    )
    residual, owner = window_residuals(A, f, theta, index, window)
    used = owner >= 0
    row = owner[used]
    residual[used] = np.clip(residual[used], -limit[row], limit[row]) / kept[row]
    correlation, _ = pooled_autocorrelation(residual, owner, A)
    std = window_deviations(A, grams, squares, index, window, correlation)
    return Trace(index, theta, std, np.sqrt(rss / window), condition, correlation)
