"""The estimators a sample at a time: state in, state out, bounded work, θ as in the replay.

Every function here takes the sums that the compiled `trace` would have for the window that ends
now, in the same order, and calls the same loops for one window: so θ equals the replay's bit for
bit. The deviations are their own, since the residuals' autocorrelation over the log is not known
yet: residuals are taken for white noise after a moving mean of `mean` samples, and the regressor
for steady over that span, which makes the textbook's variance `mean` times larger.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators import directional
from estimators import rls as recursion
from estimators import rtls as total_recursion
from estimators.compiled import compiled
from estimators.fgls import FglsOptions, weigh
from estimators.huber import HuberOptions, robust, solve_robust
from estimators.information import correlation
from estimators.linear import at, condition_number, condition_numbers, inverse_spd
from estimators.ls import predict
from estimators.normal import normal_equations, residual_squares, solve_products
from estimators.pooled import add_sample, solve_sums
from estimators.recursive import discount, packed
from estimators.reweighted import reweighting
from estimators.rls import RlsOptions, RlsState
from estimators.rolling import (
    centred_terms,
    lanes_of,
    sample_products,
    suffix_sums,
    uncentred,
)
from estimators.rtls import RtlsOptions
from estimators.tls import TlsOptions, roots, solve_scaled
from estimators.trace import Estimate, Floats


class WindowState(NamedTuple):
    """The window that ends now, and the sums of two scans (see `estimators.rolling`).

    Attributes:
        z: (p + 1, window) columns of [A f], the oldest sample first.
        seen: samples so far.
        centre: (p + 1,) the last sample of the last whole block.
        suffix: (lanes, window) sums from each sample of that block to its end.
        prefix: (lanes,) sums of the samples since.
        products: (entries, 1) packed sums of the window's products, and
        moments: (lanes, 1) their centred form; both NaN until the window is complete.
    """

    z: Floats
    seen: int
    centre: Floats
    suffix: Floats
    prefix: Floats
    products: Floats
    moments: Floats


def start_window(parameters: int, window: int) -> WindowState:
    """Before the first sample."""
    q = parameters + 1
    entries = q * (q + 1) // 2
    lanes = lanes_of(q + entries)
    return WindowState(
        np.full((q, window), np.nan),
        0,
        np.full(q, np.nan),
        np.full((lanes, window), np.nan),
        np.zeros(lanes),
        np.full((entries, 1), np.nan),
        np.full((lanes, 1), np.nan),
    )


@compiled
def step_window(state: WindowState, sample: Floats) -> WindowState:
    """Slide on by one sample (p + 1,), the regressor's row and then the force.

    Once in `window` samples the suffix sums are made anew, at the cost of as many additions.
    """
    q, window = state.z.shape
    z = np.empty((q, window))
    z[:, : window - 1] = state.z[:, 1:]
    z[:, window - 1] = sample
    seen = state.seen + 1
    centre, suffix, prefix = state.centre, state.suffix, state.prefix.copy()
    since = seen % window
    if since == 0:
        centre = sample.copy()
        terms = np.zeros((suffix.shape[0], window))
        centred_terms(z, centre, window, terms)
        suffix = np.empty((suffix.shape[0], window))
        suffix_sums(terms, window, suffix)
        prefix[:] = 0.0
    else:
        terms = np.zeros((suffix.shape[0], 1))
        centred_terms(sample.copy().reshape(q, 1), centre, 1, terms)
        for lane in range(prefix.size):
            prefix[lane] += terms[lane, 0]
    products, moments = state.products, state.moments
    if seen >= window:
        moments = np.empty((prefix.size, 1))
        for lane in range(prefix.size):
            moments[lane, 0] = suffix[lane, since] + prefix[lane]
        products = np.empty(state.products.shape)
        uncentred(moments, centre, window, 1, products)
    return WindowState(z, seen, centre, suffix, prefix, products, moments)


def rows_of(state: WindowState, newest: int) -> tuple[Floats, Floats]:
    """A (newest, p) and f (newest,) of the newest samples."""
    z = state.z[:, -newest:]
    return np.ascontiguousarray(z[:-1].T), np.ascontiguousarray(z[-1])


class Promise(NamedTuple):
    """What the gate sees of a window before it is used."""

    rho: float
    spread: float
    predicted_deviation: float
    condition: float


@compiled
def promise(state: WindowState) -> Promise:
    """ρ of the first column and the force, their spread, predicted deviation and condition."""
    q, window = state.z.shape
    p = q - 1
    five = np.empty((5, 1))
    five[0], five[1] = state.moments[0], state.moments[p]
    five[2] = state.moments[q]
    five[3] = state.moments[q + at(0, p, q)]
    five[4] = state.moments[q + at(p, p, q)]
    centre = np.array([state.centre[0], state.centre[p]])
    rho, spread, predicted, condition = np.empty(1), np.empty(1), np.empty(1), np.empty(1)
    correlation(five, centre, window, 1, rho, spread)
    predict(state.products, window, 1, normal_equations(p, 1), predicted)
    condition_numbers(state.products, q, p, 1, condition)
    return Promise(rho[0], spread[0], predicted[0], condition[0])


def _estimate(
    state: WindowState, x: Floats, G: Floats, rss: float, of_deviation: float, mean: int
) -> Estimate:
    """One window's estimate; G (p, p) stands for AᵀA, `of_deviation` for RSS in its deviation."""
    q, window = state.z.shape
    condition = np.empty(1)
    condition_numbers(state.products, q, q - 1, 1, condition)
    freedom = window - (q - 1) * mean
    variance = of_deviation / freedom * mean if freedom > 0 else np.nan
    std = np.sqrt(variance * np.diagonal(inverse_spd(G)))
    return Estimate(x[:, 0].copy(), std, float(np.sqrt(rss / window)), float(condition[0]))


def unpacked(entries: Floats, size: int, p: int) -> Floats:
    """The leading (p, p) of a packed symmetric matrix of `size` columns."""
    G = np.empty((p, p))
    for i in range(p):
        for j in range(i, p):
            G[i, j] = G[j, i] = entries[at(i, j, size)]
    return G


def _gram(state: WindowState) -> Floats:
    return unpacked(state.products[:, 0], len(state.z), len(state.z) - 1)


def ls(state: WindowState, mean: int) -> Estimate:
    """Ordinary least squares of the window that ends now."""
    p = len(state.z) - 1
    normal = normal_equations(p, 1)
    solve_products(state.products, 1, normal)
    rss = float(normal.rss[0])
    return _estimate(state, normal.x, _gram(state), rss, rss, mean)


def fgls(state: WindowState, mean: int, options: FglsOptions) -> Estimate:
    """Feasible generalised least squares of the window that ends now: O(window)."""
    q, window = state.z.shape
    normal, weighted = normal_equations(q - 1, 1), reweighting(q - 1, window)
    solve_products(state.products, 1, normal)
    end = np.array([window - 1])
    limit = np.empty(1)
    weigh(state.z, state.products, window, end, 0, 1, options.floor, normal, limit, weighted)
    rss = np.empty(1)
    x = np.ascontiguousarray(weighted.normal.x[:, :1])
    residual_squares(state.products, x, 1, rss)
    return _estimate(state, x, _gram(state), rss[0], rss[0], mean)


def tls(state: WindowState, mean: int, options: TlsOptions) -> Estimate:
    """Total least squares of the window that ends now."""
    p = len(state.z) - 1
    scale, work, rss = options.scales(p), roots(p, 1), np.empty(1)
    solve_scaled(state.products, scale, 1, work)
    x = work.normal.x
    residual_squares(state.products, x, 1, rss)
    clean = unpacked(work.shifted[:, 0], p + 1, p) * np.outer(scale, scale)
    return _estimate(state, x, clean, rss[0], rss[0], mean)


def huber(state: WindowState, mean: int, options: HuberOptions) -> Estimate:
    """Huber's regression of the window that ends now: O(window) a step of at most a hundred."""
    q, window = state.z.shape
    normal, room, rss = normal_equations(q - 1, 1), robust(q - 1, window), np.empty(1)
    solve_products(state.products, 1, normal)
    end = np.array([window - 1])
    solve_robust(state.z, window, end, 0, 1, options.bend, normal.x, room)
    x = np.ascontiguousarray(room.theta[:, :1])
    residual_squares(state.products, x, 1, rss)
    return _estimate(state, x, _gram(state), rss[0], float(room.squares[0]), mean)


@dataclass(frozen=True, slots=True)
class Past:
    """What a recursive estimator keeps of the samples it was fed.

    Attributes:
        products: (lanes,) packed, discounted products of the columns of [A f].
        squares: (lanes,) packed AᵀA, discounted by λ²: what the errors of Aᵀf vary by.
        weight: discounted number of samples.
    """

    products: Floats
    squares: Floats
    weight: float


def _fed(state: WindowState, past: Past, newest: int, forgetting: float) -> Past:
    """Feed the newest samples of the window."""
    q = len(state.z)
    z = np.ascontiguousarray(state.z[:, -newest:])
    products, squares = past.products.copy(), past.squares.copy()
    weight = past.weight
    for sums, columns, decay in ((products, q, forgetting), (squares, q - 1, forgetting**2)):
        terms = np.zeros((sums.size, newest))
        sample_products(z[:columns], newest, terms)
        discount(terms, newest, decay, sums, np.empty((sums.size, newest)))
    for _ in range(newest):
        weight = forgetting * weight + 1.0
    return Past(products, squares, weight)


def _recursive_estimate(
    theta: Floats, past: Past, bread: Floats, rss: float, condition: float, mean: int
) -> Estimate:
    """The errors of θ are `bread` (p, p) times those of Aᵀf."""
    p = theta.size
    M = unpacked(past.squares, p, p)
    variance = rss / past.weight * mean
    std = np.sqrt(variance * np.diagonal(bread @ M @ bread))
    return Estimate(theta, std, float(np.sqrt(rss / past.weight)), condition)


def rls(
    state: WindowState, past: Past | None, newest: int, mean: int, options: RlsOptions
) -> tuple[Past, Estimate]:
    """Feed the newest samples of an accepted window, or begin with its OLS estimate.

    Args:
        state: the window.
        past: after the accepted window before, None for the first.
        newest: samples that no accepted window had.
        mean: samples of the moving mean.
        options: the forgetting.
    """
    p = len(state.z) - 1
    if past is None:
        begin = recursion.start(*rows_of(state, state.z.shape[1]), options)
        G, R = _gram(state), np.diag(1.0 / np.diagonal(begin.P))
        first = Past(
            packed(recursion.information(begin)),
            packed(R @ inverse_spd(G) @ R),
            begin.weight,
        )
        bread = inverse_spd(R)
        return first, _recursive_estimate(
            begin.theta, first, bread, begin.square, condition_number(G), mean
        )
    past = _fed(state, past, newest, options.forgetting)
    normal = normal_equations(p, 1)
    solve_products(past.products.reshape(-1, 1), 1, normal)
    R = unpacked(past.products, p + 1, p)
    rss, condition = float(normal.rss[0]), condition_number(R)
    theta = normal.x[:, 0].copy()
    return past, _recursive_estimate(theta, past, inverse_spd(R), rss, condition, mean)


def directional_rls(
    state: WindowState, past: RlsState | None, newest: int, mean: int, options: RlsOptions
) -> tuple[RlsState, Estimate]:
    """The same with directional forgetting, whose past is its covariance."""
    window = state.z.shape[1]
    A, f = rows_of(state, window)
    if past is None:
        past = recursion.start(A, f, options)
        R = _gram(state)
    else:
        ends = np.array([window - 1 - newest, window - 1])
        sums = (past.square, past.weight)
        theta, _, information, kept = directional.feed(
            A, f, window, ends, options.forgetting, past.theta, past.P, sums
        )
        past = RlsState(theta[-1], *kept)
        R = information[-1]
    rms = float(np.sqrt(max(past.square, 0.0) / past.weight))
    std = rms * np.sqrt(mean * np.diagonal(inverse_spd(R)))
    return past, Estimate(past.theta, std, rms, condition_number(R))


def rtls(
    state: WindowState, past: Past | None, newest: int, mean: int, options: RtlsOptions
) -> tuple[Past, Estimate]:
    """Recursive total least squares; arguments as for `rls`."""
    p = len(state.z) - 1
    scale, work, rss = options.noise.scales(p), roots(p, 1), np.empty(1)
    if past is None:
        begin = total_recursion.start(*rows_of(state, state.z.shape[1]), options)
        past = Past(
            packed(total_recursion.unscaled(begin, options)), packed(_gram(state)), begin.weight
        )
    else:
        past = _fed(state, past, newest, options.forgetting)
    products = past.products.reshape(-1, 1)
    solve_scaled(products, scale, 1, work)
    residual_squares(products, work.normal.x, 1, rss)
    clean = unpacked(work.shifted[:, 0], p + 1, p) * np.outer(scale, scale)
    condition = condition_number(unpacked(past.products, p + 1, p))
    theta = work.normal.x[:, 0].copy()
    return past, _recursive_estimate(theta, past, inverse_spd(clean), rss[0], condition, mean)


@dataclass(frozen=True, slots=True)
class Pool:
    """The samples of one manoeuvre so far: packed products (entries,), and how many."""

    products: Floats
    samples: int

    def add(self, sample: Floats) -> "Pool":
        """This and one sample (p + 1,) more."""
        products = self.products.copy()
        add_sample(sample[:-1].copy(), sample[-1], products)
        return Pool(products, self.samples + 1)

    def estimate(self, mean: int) -> Estimate:
        """Least squares of all of them."""
        theta, condition = solve_sums(self.products.reshape(-1, 1))
        p = theta.shape[1]
        G, rss = unpacked(self.products, p + 1, p), np.empty(1)
        residual_squares(self.products.reshape(-1, 1), theta.T.copy(), 1, rss)
        freedom = self.samples - p * mean
        variance = rss[0] / freedom * mean if freedom > 0 else np.nan
        std = np.sqrt(variance * np.diagonal(inverse_spd(G)))
        return Estimate(theta[0], std, float(np.sqrt(rss[0] / self.samples)), float(condition[0]))


def start_pool(parameters: int) -> Pool:
    """Before the first sample."""
    return Pool(np.zeros((parameters + 1) * (parameters + 2) // 2), 0)
