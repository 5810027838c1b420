"""Which of a series' values share one level: exact change points, with scatter and shared effects.

Each unit (a manoeuvre, say) has y = level + x β + δ + ε: ε of a known variance v, δ the scatter
between units of one level, β effects that all units share and about which the units know something
of their own. The partition is the one with the largest posterior probability. Its prior is not
tuned: every number of changes is as likely as any other, and so is every choice of as many places
(Scott & Berger 2010, Bayes and empirical-Bayes multiplicity adjustment); a level is anything within
`spread`; scatter is half-Cauchy with the scale of the units' own deviation (Gelman 2006, Prior
distributions for variance parameters). Given β and the scatter it is found exactly, by optimal
partitioning (Jackson et al. 2005, An algorithm for optimal partitioning of data on an interval).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, logsumexp

from estimators.autocorrelation import pooled_autocorrelation
from estimators.compiled import compiled
from estimators.estimate import Floats, Ints
from estimators.group_sums import GroupSums, NoiseMoments
from estimators.sandwich import meat

#: Scatter that is tried, over the units' own deviation, where it is not known.
_SCATTERS: Final = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 25.0, 50.0)
#: Probabilities of a change by which candidates are made; the posterior chooses.
_CANDIDATES: Final = (0.02, 0.2, 0.5)
#: Scatter's prior: half-Cauchy of so many of the units' own deviations.
_SCATTER: Final = 6.0
_ROUNDS: Final = 10
#: Rounds of residuals and their variance.
_NOISE_ROUNDS: Final = 3
#: So many units share their effects.
_MANY: Final = 5
#: Of a unit's sum of squares at least this share is no noise.
_LEAST_OWN: Final = 0.1
#: No change is ruled out for good, but for this much it takes evidence.
_NEVER: Final = 1e9


@dataclass(frozen=True, slots=True)
class Units:
    """What each unit says of its level, and all of what they share.

    Attributes:
        y: (n,) level where β is 0.
        x: (n, r) how β moves it: y - x β is the level.
        variance: (n,) of y by the unit alone.
        gram: (r, r) information about β within units and from its prior.
        cross: (r,) likewise its right-hand side.
        kind: (n - 1,) of each boundary: 0 no change can be there, else places of one kind are
            alike (a hint of a boom, say, is another kind than a standstill).
    """

    y: Floats
    x: Floats
    variance: Floats
    gram: Floats
    cross: Floats
    kind: Ints


def units_of(
    A: Floats,
    f: Floats,
    group: Ints,
    noise: NoiseMoments | None,
    prior_mean: Floats,
    prior_std: Floats,
    unit: Ints,
) -> Units:
    """What each unit says of the first parameter of A θ = f, all others shared.

    Every unit has a level of its own here, so that what changes between units is in no residual.

    Args:
        A: (n, p) columns.
        f: (n,) response.
        group: (n,) the group of each sample, negative for none.
        noise: of the columns; None takes them as exact.
        prior_mean: (p - 1,) of the others.
        prior_std: (p - 1,), inf where nothing is known.
        unit: (groups,) the unit of each group, from 0.

    Returns:
        The units, each boundary of kind 1.
    """
    used = group >= 0
    n = int(used.sum())
    scale = np.sqrt((A[used] ** 2).mean(axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    A = np.ascontiguousarray(np.where(used[:, None], A / scale, 0.0))
    f = np.where(used, f, 0.0)
    sums = GroupSums.of(A, f, group, noise, scale)
    of_group = np.zeros(f.size, np.int64)
    for part, number in zip(sums.rows, unit, strict=True):
        of_group[part] = number
    each = sums.by(unit)
    precision = np.where(np.isfinite(prior_std), (prior_std * scale[1:]) ** -2.0, 0.0)
    clean, bare = each.grams - each.noise_gram, each.crosses - each.noise_cross
    # a unit whose acceleration is noise says nothing, and not the contrary
    own = np.maximum(clean[:, 0, 0], _LEAST_OWN * each.grams[:, 0, 0])
    y, x = bare[:, 0] / own, clean[:, 0, 1:] / own[:, None]
    within = (clean[:, 1:, 1:] - own[:, None, None] * x[:, :, None] * x[:, None, :]).sum(axis=0)
    cross = (bare[:, 1:] - (own * y)[:, None] * x).sum(axis=0)
    squares, vectors = np.linalg.eigh(within)
    within = (vectors * np.maximum(squares, 0.0)) @ vectors.T
    variance = float(f[used] @ f[used]) / n
    level, correlation, white = y, np.ones(1), variance
    # few units share their effects with few others: as if each had its own
    own_columns = A[:, :1] if y.size >= _MANY else A[:, _moving(A)]
    for _ in range(_NOISE_ROUNDS):
        whole = within / variance + np.diag(precision)
        beta = np.linalg.lstsq(whole, cross / variance + precision * prior_mean * scale[1:])[0]
        level = y - x @ beta
        residual = np.where(used, f - A[:, 0] * level[of_group] - A[:, 1:] @ beta, 0.0)
        correlation, _ = pooled_autocorrelation(residual, group, own_columns)
        white = float(residual @ residual) / max(n - level.size, 1)
        variance = white * max(2.0 * float(correlation.sum()) - 1.0, 1.0)
    first = np.ascontiguousarray(A[:, :1])
    sandwiched = sum(
        float(
            meat(first, group, int(group[part[0]]), int(part[0]), int(part[-1]), correlation)[0, 0]
        )
        for part in sums.rows
    )
    per_square = white * max(sandwiched / float(each.grams[:, 0, 0].sum()), 1.0)
    back = scale[1:]
    return Units(
        y / scale[0],
        x * back / scale[0],
        per_square * each.grams[:, 0, 0] / own**2 / scale[0] ** 2,
        (within / variance + np.diag(precision)) * np.outer(back, back),
        (cross / variance + precision * prior_mean * back) * back,
        np.ones(level.size - 1, np.int64),
    )


def _moving(A: Floats) -> NDArray[np.bool_]:
    """Which columns are not 0 throughout."""
    return np.abs(A).sum(axis=0) > 0.0


@dataclass(frozen=True, slots=True)
class Partition:
    """A partition and what it says.

    Attributes:
        state: (n,) number of the level of each unit, from 0.
        levels: (states,).
        scatter: standard deviation between units of one level.
        effects: (r,) β.
        log_posterior: up to a constant of the series.
    """

    state: Ints
    levels: Floats
    scatter: float
    effects: Floats
    log_posterior: float

    @property
    def states(self) -> int:
        """How many levels there are."""
        return self.levels.size


@dataclass(frozen=True, slots=True)
class Partitions:
    """The best partition and those it was chosen from.

    Attributes:
        best: the most probable.
        single: with one level.
        single_probability: how probable one level is, among all that were tried, each at its best
            scatter.
    """

    best: Partition
    single: Partition
    single_probability: float


def partitions(units: Units, spread: float, scatter: float | None = None) -> Partitions:
    """Find the most probable partition.

    Args:
        units: in their order.
        spread: how far apart levels may be.
        scatter: standard deviation between units of one level; None where it is not known.
    """
    n = units.y.size
    typical = float(np.sqrt(np.median(units.variance)))
    scatters = [times * typical for times in _SCATTERS] if scatter is None else [scatter]
    one = np.zeros(n, np.int64)
    begin = [_effects(units, one, units.variance), _effects(units, np.arange(n), units.variance)]
    found: dict[bytes, Partition] = {}
    for tau in scatters:
        prior = -np.log1p((tau / typical / _SCATTER) ** 2) if scatter is None else 0.0
        variance = units.variance + tau**2
        tried: set[bytes] = {one.tobytes()}
        for effects in begin:
            for probability in _CANDIDATES:
                tried |= _alternated(units, variance, spread, probability, effects)
        for key in tried:
            state = np.frombuffer(key, np.int64)
            posterior = prior + _log_posterior(units, state, variance, spread)
            if key not in found or posterior > found[key].log_posterior:
                effects = _effects(units, state, variance)
                levels = _levels(units, state, variance, effects)
                found[key] = Partition(state, levels, tau, effects, posterior)
    best = max(found.values(), key=lambda each: each.log_posterior)
    single = found[one.tobytes()]
    logs = np.array([each.log_posterior for each in found.values()])
    return Partitions(best, single, float(np.exp(single.log_posterior - logsumexp(logs))))


def _alternated(
    units: Units, variance: Floats, spread: float, probability: float, effects: Floats
) -> set[bytes]:
    """Partitions of given effects, and effects of that partition, until nothing changes."""
    cost = np.full(units.y.size - 1, -2.0 * np.log(probability / (1.0 - probability)))
    cost[units.kind == 0] = _NEVER
    tried: set[bytes] = set()
    for _ in range(_ROUNDS):
        state = _optimal(units.y - units.x @ effects, 1.0 / variance, cost, spread)
        key = state.tobytes()
        if key in tried:
            break
        tried.add(key)
        effects = _effects(units, state, variance)
    return tried


@compiled
def _optimal(level: Floats, weight: Floats, cost: Floats, spread: float) -> Ints:
    """The partition of least cost: Σ w (y - ȳ)² + log(W L²/2π) a level, and the changes' own."""
    n = level.size
    w, wy, wyy = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    middle = level.mean()
    for k in range(n):
        y = level[k] - middle
        w[k + 1] = w[k] + weight[k]
        wy[k + 1] = wy[k] + weight[k] * y
        wyy[k + 1] = wyy[k] + weight[k] * y * y
    best = np.zeros(n + 1)
    before = np.zeros(n + 1, np.int64)
    for end in range(1, n + 1):
        least = np.inf
        for begin in range(end):
            inside, sums = w[end] - w[begin], wy[end] - wy[begin]
            total = best[begin] + wyy[end] - wyy[begin] - sums * sums / inside
            total += np.log(inside * spread * spread / (2.0 * np.pi))
            if begin > 0:
                total += cost[begin - 1]
            if total < least:
                least = total
                before[end] = begin
        best[end] = least
    state = np.zeros(n, np.int64)
    end = n
    while end > 0:
        begin = before[end]
        for k in range(begin, end):
            state[k] = begin
        end = begin
    number, last = -1, -1
    for k in range(n):
        if state[k] != last:
            number, last = number + 1, state[k]
        state[k] = number
    return state


def _sums(values: Floats, state: Ints) -> Floats:
    """Sum rows by state."""
    out = np.zeros((int(state[-1]) + 1, *values.shape[1:]))
    np.add.at(out, state, values)
    return out


def _between(units: Units, state: Ints, variance: Floats) -> tuple[Floats, Floats]:
    """Normal equations of β from the units of one level that are apart, (r, r) and (r,)."""
    weight = 1.0 / variance
    total = _sums(weight, state)
    mean_x = _sums(weight[:, None] * units.x, state) / total[:, None]
    mean_y = _sums(weight * units.y, state) / total
    x, y = units.x - mean_x[state], units.y - mean_y[state]
    return (weight[:, None] * x).T @ x, (weight[:, None] * x).T @ y


def _effects(units: Units, state: Ints, variance: Floats) -> Floats:
    """β given the partition."""
    gram, cross = _between(units, state, variance)
    return np.asarray(np.linalg.solve(units.gram + gram, units.cross + cross), np.float64)


def _levels(units: Units, state: Ints, variance: Floats, effects: Floats) -> Floats:
    """The levels given partition and β."""
    weight = 1.0 / variance
    return _sums(weight * (units.y - units.x @ effects), state) / _sums(weight, state)


def _log_posterior(units: Units, state: Ints, variance: Floats, spread: float) -> float:
    """Of the partition, levels and β integrated out; up to a constant of the series."""
    gram, cross = _between(units, state, variance)
    whole, right = units.gram + gram, units.cross + cross
    effects = np.asarray(np.linalg.solve(whole, right), np.float64)
    weight = 1.0 / variance
    left = units.y - units.x @ effects
    left = left - _levels(units, state, variance, effects)[state]
    # β's own misfit is that of its normal equations, up to a constant
    misfit = float(weight @ left**2) + float(
        effects @ units.gram @ effects - 2.0 * effects @ units.cross
    )
    levels = np.log(_sums(weight, state) * spread**2 / (2.0 * np.pi)).sum()
    logs = np.log(variance).sum() + levels + float(np.linalg.slogdet(whole)[1])
    return -0.5 * (misfit + float(logs)) + _log_prior(units.kind, np.diff(state) > 0)


def _log_prior(kind: Ints, changes: NDArray[np.bool_]) -> float:
    """Every number of changes alike, and every choice of as many among places of a kind."""
    total = 0.0
    for each in np.unique(kind[kind > 0]):
        places, used = int((kind == each).sum()), int(changes[kind == each].sum())
        # ∫ pᵏ (1 - p)ⁿ⁻ᵏ dp
        total += float(betaln(used + 1, places - used + 1))
    return total
