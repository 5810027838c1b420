"""What every estimator promises, checked on each by the same named checks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from analysis.model.methods import METHODS, AxisNoise, FeedKind, MethodOptions
from estimators.estimate import Trace
from estimators.methods import fgls, ls, rls, rtls, tls
from estimators.numerics.autocorrelation import (
    compute_disjoint_window_residuals,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.small_systems import compute_scaled_condition

WINDOW = 40
#: Accepted window ends: two stretches that share samples, one alone, one far away.
ENDS = [*range(60, 90), *range(105, 121), 200, *range(300, 331)]
THETA = np.array([3614.0, 2891.0, 300.0])


@dataclass(frozen=True)
class Log:
    A: np.ndarray
    f: np.ndarray
    accepted: np.ndarray

    @property
    def union(self):
        """Every sample that lies in an accepted window."""
        inside = np.zeros(self.f.size, bool)
        for k in np.flatnonzero(self.accepted):
            inside[k - WINDOW + 1 : k + 1] = True
        return inside


def make_log(parameters, noise=60.0, ends=ENDS, seed=7):
    """Correlated motion with a sign column, and NaN wherever no accepted window looks."""
    generator = np.random.default_rng(seed)
    n = 400
    kernel = np.ones(5) / 5
    motion = np.column_stack(
        [np.convolve(generator.normal(size=n + 4), kernel, "valid") for _ in range(2)]
    )
    A = np.column_stack([motion, np.where(np.arange(n) % 29 < 15, 1.0, -1.0)])[:, :parameters]
    A = np.ascontiguousarray(A)
    correlated = np.convolve(generator.normal(size=n + 4), kernel, "valid")
    f = A @ THETA[:parameters] + noise * correlated
    accepted = np.zeros(n, bool)
    accepted[ends] = True
    log = Log(A, f, accepted)
    outside = ~log.union
    A[outside] = np.nan
    f[outside] = np.nan
    return log


def segments_of(log):
    """Each run of samples in accepted windows is a segment, -1 for the others."""
    inside = log.union
    begins = np.diff(inside.astype(int), prepend=0) > 0
    return np.where(inside, np.cumsum(begins) - 1, -1).astype(np.int64)


# What each estimator says of one log, and what its readable form says of the same rows.


def windows_by_fit(method) -> Callable[[Log, Trace, object], list]:
    def expected(log, traced, options):
        rows = []
        for k in np.flatnonzero(log.accepted):
            window = slice(k - WINDOW + 1, k + 1)
            one = method.fit(log.A[window], log.f[window], options, traced.autocorrelation)
            rows.append((k, one.theta, one.std, one.residual_rms, one.condition))
        return rows

    return expected


def repeated_steps(log, _traced, options):
    """`step`, once a sample of the union; the deviation is that of what is linear in the force."""
    ends = np.flatnonzero(log.accepted)
    first = slice(ends[0] - WINDOW + 1, ends[0] + 1)
    state = rls.start(log.A[first], log.f[first], options)
    gram = log.A[first].T @ log.A[first]
    fed = list(range(first.start, first.stop))
    weights = np.linalg.pinv(log.A[first])
    alone = ls.estimate_along_log(log.A, log.f, WINDOW, log.accepted)
    residuals = compute_disjoint_window_residuals(log.A, log.f, alone.theta, ends, WINDOW)
    correlation, variance = estimate_pooled_autocorrelation(*residuals, log.A)

    def std():
        cover = weights @ correlation_matrix(fed, correlation) @ weights.T
        return np.sqrt(variance * np.maximum(cover, weights @ weights.T).diagonal())

    rows = [(ends[0], state.theta, std(), rms_of(state), compute_scaled_condition(gram))]
    inside = log.union
    for k in range(ends[0] + 1, log.f.size):
        if inside[k]:
            weights = weights_after(state, weights, log.A[k], options)
            fed.append(k)
            state = rls.step(state, log.A[k], log.f[k], options)
        if log.accepted[k]:
            condition = compute_scaled_condition(np.linalg.inv(state.P))
            rows.append((k, state.theta, std(), rms_of(state), condition))
    return rows


def weights_after(state, weights, a, options):
    """What each sample's force counts in θ, (p, samples), once `a` is fed too: θ is linear in f."""

    def estimate(theta, force):
        return rls.step(rls.RlsState(theta, state.P, 0.0, 1.0), a, force, options).theta

    kept = [estimate(column, 0.0) for column in weights.T]
    return np.column_stack([*kept, estimate(np.zeros(a.size), 1.0)])


def correlation_matrix(samples, correlation):
    """R of residuals that lie so many samples apart."""
    lag = np.abs(np.subtract.outer(samples, samples))
    last = correlation.size - 1
    return np.where(lag <= last, correlation[np.minimum(lag, last)], 0.0)


def repeated_total_steps(log, _traced, options):
    """The same for recursive TLS, whose residuals are those of all the past under one θ."""
    ends = np.flatnonzero(log.accepted)
    first = slice(ends[0] - WINDOW + 1, ends[0] + 1)
    state = rtls.start(log.A[first], log.f[first], options)
    scale = options.noise.list_column_scales(log.A.shape[1])
    inside = log.union
    fed, weights = list(range(first.start, first.stop)), np.ones(WINDOW)
    residual, owner = np.zeros(log.f.size), np.full(log.f.size, -1)
    rows, covers = [], []
    for k in range(ends[0], log.f.size):
        if inside[k] and k > ends[0]:
            state = rtls.step(state, log.A[k], log.f[k], options)
            fed.append(k)
            weights = np.append(options.forgetting * weights, 1.0)
        if log.accepted[k]:
            x = np.append(-state.theta * scale, 1.0)
            rms = np.sqrt(x @ state.C @ x / state.weight)
            condition = compute_scaled_condition(state.C[:-1, :-1].copy())
            rows.append((k, state.theta, rms, condition))
            new = [sample for sample in fed if owner[sample] < 0]
            residual[new], owner[new] = log.f[new] - log.A[new] @ state.theta, 0
            covers.append((clean_gram(state.C, scale), log.A[fed] * weights[:, None], list(fed)))
    correlation, variance = estimate_pooled_autocorrelation(residual, owner, None)
    for row, (gram, weighted, samples) in enumerate(covers):
        bread = np.linalg.inv(gram)
        meat = weighted.T @ correlation_matrix(samples, correlation) @ weighted
        cover = np.maximum(bread @ meat @ bread, bread @ weighted.T @ weighted @ bread)
        index, theta, *others = rows[row]
        rows[row] = (index, theta, np.sqrt(variance * cover.diagonal()), *others)
    return rows


def clean_gram(C, scale):
    """AᵀA of the scaled [A f] without its noise, whose square is the smallest eigenvalue."""
    smallest = np.linalg.eigvalsh(C)[0]
    return (C[:-1, :-1] - smallest * np.eye(scale.size)) * np.outer(scale, scale)


def rms_of(state):
    return np.sqrt(state.square / state.weight)


def segments_by_lstsq(log, traced, options):
    manoeuvre_of_sample = segments_of(log)
    rows = []
    for number in range(manoeuvre_of_sample.max() + 1):
        mine = manoeuvre_of_sample == number
        one = ls.fit(log.A[mine], log.f[mine], options, traced.autocorrelation)
        last = np.flatnonzero(mine)[-1]
        rows.append((last, one.theta, one.std, one.residual_rms, one.condition))
    return rows


@dataclass(frozen=True)
class Estimator:
    estimate_along_log: Callable[..., Trace]
    rows: Callable[[Log, Trace, object], list]
    options: object
    options_at_ten_times_the_force: object


def windowed(method, options, scaled=None):
    def estimate_along_log(log, options):
        return method.estimate_along_log(log.A, log.f, WINDOW, log.accepted, options)

    return Estimator(estimate_along_log, windows_by_fit(method), options, scaled or options)


def recursive(method, options, scaled=None):
    def estimate_along_log(log, options):
        return method.estimate_along_log(log.A, log.f, WINDOW, log.accepted, options)

    return Estimator(estimate_along_log, STEPS[method], options, scaled or options)


def by_segment(method, options, scaled=None):
    def estimate_along_log(log, options):
        return method.estimate_along_log(log.A, log.f, segments_of(log), options)

    return Estimator(estimate_along_log, segments_by_lstsq, options, scaled or options)


STEPS = {rls: repeated_steps, rtls: repeated_total_steps}
FORMS = {FeedKind.WINDOWS: windowed, FeedKind.SETTLED: recursive, FeedKind.SEGMENTS: by_segment}


def in_the_table(method):
    """The estimator of a row, with the options that the defaults make of some noise."""
    once, ten = (
        method.options(MethodOptions(), AxisNoise(ratios, None, None))
        for ratios in (tls.TlsOptions((0.05, 0.05, 1e-3), f_N) for f_N in (60.0, 600.0))
    )
    return FORMS[method.feed](method.estimator, once, ten)


ESTIMATORS = {
    **{name: in_the_table(method) for name, method in METHODS.items()},
    "fgls with a large floor": windowed(fgls, fgls.FglsOptions(floor=0.5)),
    "rls that forgets quickly": recursive(rls, rls.RlsOptions(forgetting=0.95)),
    "rls that forgets along the samples alone": recursive(
        rls, rls.RlsOptions(forgetting=0.95, directional=True)
    ),
}

CHECKS = []


def check(function):
    CHECKS.append(function)
    return function


def run(estimator, log):
    return estimator.estimate_along_log(log, estimator.options)


@check
def each_row_equals_the_readable_form(estimator, parameters):
    log = make_log(parameters)
    traced = run(estimator, log)
    rows = estimator.rows(log, traced, estimator.options)
    index, theta, std, rms, condition = (np.array(column) for column in zip(*rows, strict=True))
    np.testing.assert_array_equal(traced.index, index)
    np.testing.assert_allclose(traced.theta, theta, rtol=1e-9)
    np.testing.assert_allclose(traced.std, std, rtol=1e-7)
    np.testing.assert_allclose(traced.residual_rms, rms, rtol=1e-7)
    np.testing.assert_allclose(traced.condition, condition, rtol=1e-7)


@check
def what_lies_outside_accepted_windows_does_not_matter(estimator, parameters):
    log = make_log(parameters)
    outside = ~log.union
    first = run(estimator, log)
    log.A[outside] = 1e9
    log.f[outside] = -1e9
    assert_same(first, run(estimator, log))


@check
def noise_free_data_give_the_truth(estimator, parameters):
    log = make_log(parameters, noise=0.0)
    traced = run(estimator, log)
    truth = np.broadcast_to(THETA[:parameters], traced.theta.shape)
    np.testing.assert_allclose(traced.theta, truth, rtol=1e-7)
    typical = np.sqrt(np.nanmean(log.f**2))
    assert traced.residual_rms.max() < 1e-6 * typical
    # fᵀf less what is explained keeps half the digits
    assert traced.std.max() < 1e-6 * typical


@check
def ten_times_the_force_is_ten_times_the_parameters(estimator, parameters):
    log = make_log(parameters)
    once = run(estimator, log)
    ten = estimator.estimate_along_log(
        Log(log.A, 10.0 * log.f, log.accepted), estimator.options_at_ten_times_the_force
    )
    np.testing.assert_allclose(ten.theta, 10.0 * once.theta, rtol=1e-9)
    np.testing.assert_allclose(ten.std, 10.0 * once.std, rtol=1e-7)
    np.testing.assert_allclose(ten.residual_rms, 10.0 * once.residual_rms, rtol=1e-7)
    np.testing.assert_allclose(ten.condition, once.condition, rtol=1e-9)


@check
def inputs_are_left_as_they_were(estimator, parameters):
    log = make_log(parameters)
    before = (log.A.copy(), log.f.copy(), log.accepted.copy())
    run(estimator, log)
    for now, then in zip((log.A, log.f, log.accepted), before, strict=True):
        np.testing.assert_array_equal(now, then)


@check
def the_same_call_gives_the_same_answer(estimator, parameters):
    log = make_log(parameters)
    assert_same(run(estimator, log), run(estimator, log))


@check
def nothing_accepted_gives_an_empty_trace(estimator, parameters):
    traced = run(estimator, make_log(parameters, ends=[]))
    assert_shapes(traced, rows=0, parameters=parameters)
    np.testing.assert_array_equal(traced.autocorrelation, [1.0])


@check
def a_log_of_one_window_gives_one_row(estimator, parameters):
    long = make_log(parameters)
    whole = Log(
        long.A[61 - WINDOW : 61].copy(), long.f[61 - WINDOW : 61].copy(), np.arange(40) == 39
    )
    traced = run(estimator, whole)
    assert_shapes(traced, rows=1, parameters=parameters)
    assert traced.index[0] == WINDOW - 1
    np.testing.assert_allclose(traced.theta[0], THETA[:parameters], rtol=0.5)
    assert np.isfinite(traced.std).all()


@check
def shapes_dtypes_and_signs_are_those_declared(estimator, parameters):
    traced = run(estimator, make_log(parameters))
    assert_shapes(traced, rows=traced.index.size, parameters=parameters)
    assert (np.diff(traced.index) > 0).all()
    assert (traced.std > 0).all()
    assert (traced.residual_rms > 0).all()
    assert (traced.condition >= 1).all()
    assert traced.autocorrelation[0] == 1.0


def assert_shapes(traced, rows, parameters):
    shapes = {
        "index": (rows,),
        "theta": (rows, parameters),
        "std": (rows, parameters),
        "residual_rms": (rows,),
        "condition": (rows,),
    }
    for name, shape in shapes.items():
        array = getattr(traced, name)
        assert array.shape == shape
        assert array.dtype == (np.int64 if name == "index" else np.float64)
    assert traced.autocorrelation.ndim == 1


def assert_same(first, second):
    for name in Trace.__slots__:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize("parameters", [2, 3])
@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS.keys())
@pytest.mark.parametrize("check", CHECKS, ids=lambda function: function.__name__)
def test_every_estimator(check, estimator, parameters):
    check(estimator, parameters)
