"""The estimators' speed against what a user would write: one core each, the same windows.

    make bench      # or: python -P benchmarks/speed.py [--samples 1e6] [--pairs 5]

Peers: statsmodels' RollingOLS and WLS, pandas' rolling sums and correlation, NumPy's SVD, padasip's
RLS. Ours and the peer run in turn, `--pairs` times; what counts is processor time, and the median
of the pairs' ratios. A slow peer runs on fewer windows of the same data, so that its rate is
extrapolated; the table says on how many. Before its ratio is printed, a peer's answer is compared
with ours. Prints Markdown.
"""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import typer
from numba import njit

from estimators.arrays import Floats, Ints
from estimators.methods import fgls, tls
from estimators.numerics.mutual_information import sum_window_products_and_correlation
from estimators.numerics.normal_equations import solve_packed_equations
from estimators.numerics.recursive import (
    accumulate_discounted_products,
    iter_sample_chunks,
    list_samples_fed_after_first_window,
    pad_entries_to_lanes,
)
from estimators.numerics.rolling import sum_window_products
from estimators.numerics.small_systems import pack_symmetric_matrix
from estimators.threads import run_in_chunks

#: One core each.
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
WINDOW = 320
NOISE = tls.TlsOptions((0.01, 0.005), 60.0)


@dataclass(frozen=True)
class Data:
    """Smoothed motion of a loader: every window is used."""

    A: Floats
    f: Floats

    @property
    def index(self) -> Ints:
        """The last samples of the windows."""
        return np.arange(WINDOW - 1, self.f.size)

    def first(self, windows: int) -> "Data":
        """The first of them."""
        return Data(self.A[: windows + WINDOW - 1], self.f[: windows + WINDOW - 1])


def make(samples: int) -> Data:
    """Starts and stops of 12 s, after a mean of ten samples, with the paper's noise."""
    generator = np.random.default_rng(1)
    t = np.arange(samples + 9) / 100.0
    a = 0.8 * np.cos(t * np.pi / 6.0) + 0.2 * np.cos(t * 1.7)
    v = 1.0 + 0.8 * np.sin(t * np.pi / 6.0) * 6.0 / np.pi
    f = 3614.0 * a + 2891.0 * v
    kernel = np.ones(10) / 10
    noisy = [
        np.convolve(x + sigma * generator.normal(size=x.size), kernel, "valid")
        for x, sigma in ((a, 0.01), (v, 0.005), (f, 60.0))
    ]
    return Data(np.column_stack(noisy[:2]), noisy[2])


def cpu_s(function: Callable[[], object]) -> float:
    began = time.process_time()
    function()
    return time.process_time() - began


@dataclass(frozen=True)
class Pair:
    """One comparison: both give an array of a row a window, ours on all, theirs on `windows`."""

    what: str
    peer: str
    target: float
    ours: Callable[[Data], Floats]
    theirs: Callable[[Data], Floats]
    windows: int
    agree: float

    def run(self, data: Data, pairs: int) -> str:
        """Compare the answers, then the rates: a row of the table."""
        few = data.first(min(self.windows, data.index.size))
        mine, peers = self.ours(few), self.theirs(few)
        mine = mine[-len(peers) :, : peers.shape[1]]
        error = float(np.nanmax(np.abs(peers - mine) / np.abs(peers).max(axis=0)))
        assert error < self.agree, f"{self.what}: {self.peer} differs by {error:.1e}"
        ours, theirs = [], []
        for _ in range(pairs):
            ours.append(data.index.size / cpu_s(lambda: self.ours(data)))
            theirs.append(few.index.size / cpu_s(lambda: self.theirs(few)))
        ratio = np.median(np.array(ours) / np.array(theirs))
        cells = [
            self.what,
            self.peer,
            f"{np.median(ours) / 1e6:.2f}",
            f"{np.median(theirs) / 1e3:.1f}",
            f"{few.index.size:,}",
            f"{ratio:,.0f}×",
            f"≥ {self.target:g}×",
            "yes" if ratio >= self.target else "no",
            f"{error:.0e}",
        ]
        return "| " + " | ".join(cells) + " |"


# Ours: what gives the point estimates of every window.


def ols_and_rho(data: Data) -> Floats:
    out, index = np.empty((data.index.size, 3)), data.index

    def work(rows: slice) -> None:
        products, rho, _ = sum_window_products_and_correlation(data.A, data.f, WINDOW, index[rows])
        out[rows, :2] = solve_packed_equations(products).theta.T
        out[rows, 2] = rho

    run_in_chunks(work, index.size)
    return out


def ols(data: Data) -> Floats:
    out, index = np.empty((data.index.size, 2)), data.index

    def work(rows: slice) -> None:
        out[rows] = solve_packed_equations(
            sum_window_products(data.A, data.f, WINDOW, index[rows])
        ).theta.T

    run_in_chunks(work, index.size)
    return out


def total(data: Data) -> Floats:
    return tls.solve_windows(data.A, data.f, WINDOW, data.index, NOISE).theta


def weighted(data: Data) -> Floats:
    return fgls.solve_windows(data.A, data.f, WINDOW, data.index, fgls.FglsOptions()).theta


def recursive(data: Data) -> Floats:
    """θ alone, from P₀ = I / ε and no first window, as padasip starts."""
    fed, seen = list_samples_fed_after_first_window(np.arange(1, data.f.size), 2)
    theta = np.empty((seen.size, 2))
    past = pad_entries_to_lanes(pack_symmetric_matrix(np.diag([EPSILON, EPSILON, 0.0])))
    accumulate_discounted_products(data.A, data.f, np.arange(2), 0.998, past)
    theta[0] = solve_packed_equations(past[:6].reshape(-1, 1)).theta[:, 0]
    for of_chunk, of_rows, at_rows in iter_sample_chunks(seen):
        sums = accumulate_discounted_products(data.A, data.f, fed[of_chunk], 0.998, past)
        theta[of_rows] = np.take(solve_packed_equations(sums[:6]).theta, at_rows, axis=1).T
    return theta


#: The recursion's start, far below what a sample adds.
EPSILON = 0.1


# The peers: what a user would write.


def by_bare_ols(data: Data) -> Floats:
    from statsmodels.regression.rolling import RollingOLS

    fitted = RollingOLS(data.f, data.A, window=WINDOW).fit(params_only=True)
    return np.asarray(fitted.params)[WINDOW - 1 :]


def by_rolling_ols(data: Data) -> Floats:
    from statsmodels.regression.rolling import RollingOLS

    return np.asarray(RollingOLS(data.f, data.A, window=WINDOW).fit().params)[WINDOW - 1 :]


def by_pandas(data: Data) -> Floats:
    import pandas as pd

    frame = pd.DataFrame({"a": data.A[:, 0], "v": data.A[:, 1], "f": data.f})
    a, v, f = frame["a"], frame["v"], frame["f"]
    products = pd.DataFrame({"aa": a * a, "av": a * v, "vv": v * v, "af": a * f, "vf": v * f})
    s = products.rolling(WINDOW).sum()
    determinant = s["aa"] * s["vv"] - s["av"] ** 2
    mass = (s["vv"] * s["af"] - s["av"] * s["vf"]) / determinant
    friction = (s["aa"] * s["vf"] - s["av"] * s["af"]) / determinant
    rho = a.rolling(WINDOW).corr(f)
    return np.column_stack([mass, friction, rho])[WINDOW - 1 :]


def by_svd(data: Data) -> Floats:
    units = np.append(np.array(NOISE.noise_A[:2]), NOISE.noise_f)
    stacked = np.column_stack([data.A, data.f]) / units
    out = np.empty((data.index.size, 2))
    for row, k in enumerate(data.index):
        window = stacked[k - WINDOW + 1 : k + 1]
        smallest = np.linalg.svd(window, full_matrices=False)[2][-1]
        out[row] = -smallest[:2] / smallest[2] * units[2] / units[:2]
    return out


def by_statsmodels_wls(data: Data) -> Floats:
    import statsmodels.api as sm

    out = np.empty((data.index.size, 2))
    for row, k in enumerate(data.index):
        A, f = data.A[k - WINDOW + 1 : k + 1], data.f[k - WINDOW + 1 : k + 1]
        residual = np.asarray(sm.OLS(f, A).fit().resid)
        square = np.maximum(residual**2, 0.05**2 * (residual**2).mean())
        out[row] = sm.WLS(f, A, weights=1.0 / square).fit().params
    return out


def by_padasip(data: Data) -> Floats:
    import padasip

    recursion = padasip.filters.FilterRLS(2, mu=0.998, eps=EPSILON, w="zeros")
    # it says the weights before each sample, so one sample more
    A, f = np.vstack([data.A, data.A[:1]]), np.append(data.f, 0.0)
    return np.asarray(recursion.run(f, A)[2])[2:]


ROLLING = "statsmodels RollingOLS"
PAIRS = (
    Pair("OLS and ρ", ROLLING, 1000, ols_and_rho, by_rolling_ols, 20_000, 1e-9),
    Pair("OLS and ρ", "the same, params_only", 1000, ols_and_rho, by_bare_ols, 50_000, 1e-9),
    Pair("OLS and ρ", "pandas sums, corr", 25, ols_and_rho, by_pandas, 10**9, 1e-6),
    Pair("TLS", "numpy SVD a window", 200, total, by_svd, 4_000, 1e-9),
    Pair("FGLS", "statsmodels OLS, WLS", 1000, weighted, by_statsmodels_wls, 500, 1e-9),
    Pair("RLS", "padasip FilterRLS", 800, recursive, by_padasip, 50_000, 1e-6),
)


@njit(error_model="numpy")
def triad(a: Floats, b: Floats, c: Floats) -> None:
    """STREAM's triad: two loads and a store an element."""
    for i in range(a.size):
        a[i] = b[i] + 3.0 * c[i]


def bandwidth(data: Data, pairs: int) -> str:
    """The share of the memory's bandwidth that OLS reaches."""
    size = 20_000_000
    a, b, c = np.empty(size), np.ones(size), np.ones(size)
    triad(a, b, c)
    # a store reads its line first: four times eight bytes an element
    stream = max(4 * 8 * size / cpu_s(lambda: triad(a, b, c)) for _ in range(pairs))
    # A and f in, θ out, whose lines are read before they are stored
    read, written = data.A[0].nbytes + 8, 8 * 2
    used = max((read + 2 * written) / cpu_s(lambda: ols(data)) for _ in range(pairs))
    used *= data.index.size
    return (
        f"Memory: a triad of {3 * 8 * size / 1e6:.0f} MB moves {stream / 1e9:.1f} GB/s on this "
        f"core; OLS moves {read + 2 * written} bytes a window at {used / 1e9:.1f} GB/s, "
        f"{used / stream:.0%} of it."
    )


def main(samples: float = 1e6, pairs: int = 5) -> None:
    if os.environ.get("OMP_NUM_THREADS") != "1":
        # the libraries read it as they are loaded
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **ONE_THREAD})  # noqa: S606
    data = make(round(samples))
    print(f"{data.index.size:,} windows of {WINDOW} samples, p = 2, one core, median of {pairs}\n")
    print(
        "| what | peer | ours M/s | peer k/s | peer's windows | ratio | target | reached | differ |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for pair in PAIRS:
        print(pair.run(data, pairs), flush=True)
    print(f"\n{bandwidth(data, pairs)}")


if __name__ == "__main__":
    typer.run(main)
