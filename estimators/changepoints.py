"""Which of a series' values share one level: exact change points, with scatter and shared effects.

Each unit (a manoeuvre, say) has y = level + x β + δ + ε: ε of a known variance v, δ the scatter
between units of one level, β effects that all units share and about which the units know something
of their own. The partition is the one with the largest posterior probability. Its prior is not
tuned: one level is as likely as several, of these every rate of changes is as likely as any other,
and so is every choice of as many places (Scott & Berger 2010, Bayes and empirical-Bayes
multiplicity adjustment). Levels are each their own, or two that take turns, or every second one is
one that comes back, as that of an empty machine does; each is as likely. They are normal about a
mean of their own, how far apart is the series' to say, up to `spread` (Gelman 2006, Prior
distributions for variance parameters). Scatter is
half-normal: it and a level for each unit are the same thing, and only its size tells them apart.
Given β and the scatter the partition is found exactly (`optimal_partition`). Of the most probable
one only the changes are kept that are sure, one after another.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln

from estimators.autocorrelation import pooled_autocorrelation
from estimators.estimate import Floats, Ints
from estimators.group_sums import GroupSums, NoiseMoments, scaled_columns
from estimators.optimal_partition import optimal_partition
from estimators.sandwich import meat

#: Scatter that is tried, over the units' own deviation, where it is not known.
_SCATTERS: Final = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 25.0, 50.0)
#: Probabilities of a change by which candidates are made; the posterior chooses.
_CANDIDATES: Final = (0.02, 0.2, 0.5)
#: How far levels are apart, over their spread: as a window, and as a standard deviation.
_WINDOWS: Final = (1.0, 0.1)
_DEVIATIONS: Final = 0.5 ** np.arange(6)
_HALF: Final = float(np.log(0.5))
_THIRD: Final = float(np.log(1.0 / 3.0))
_ROUNDS: Final = 10
#: Rounds of residuals and their variance.
_NOISE_ROUNDS: Final = 3
#: So many units share their effects.
_MANY: Final = 5
#: Of a unit's sum of squares at least this share is no noise.
_LEAST_OWN: Final = 0.1
#: A change is said where it is at least so much likelier than none, as a logarithm.
_SURE: Final = float(np.log(20.0))
_LEAST_CHANGES: Final = 20
#: How likely what tells a change (a boom that moves) has nothing to do with it in this series.
_TELLS_NOTHING: Final = 0.25
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
        kind: (n - 1,) of each boundary: 0 no change can be there, 1 only the units tell one, 2 and
            more what tells it besides; places of a kind are alike.
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
    A, f, scale = scaled_columns(A, f, group)
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
        state: (n,) number of the stretch of each unit, from 0.
        levels: (states,).
        level: (states,) which level each is at: one may come back.
        scatter: standard deviation between units of one level.
        effects: (r,) β.
        log_posterior: up to a constant of the series.
    """

    state: Ints
    levels: Floats
    level: Ints
    scatter: float
    effects: Floats
    log_posterior: float

    @property
    def states(self) -> int:
        """How many stretches of one level there are."""
        return self.levels.size

    @property
    def freedom(self) -> int:
        """How many units there are beyond the levels."""
        return self.state.size - int(self.level.max()) - 1


@dataclass(frozen=True, slots=True)
class Partitions:
    """The best partition and those it was chosen from.

    Attributes:
        best: the most probable, less the changes that are not sure.
        single: with one level.
        several: the most probable one with more; None of one unit.
        single_probability: how probable one level is, among all that were tried, each at its best
            scatter.
    """

    best: Partition
    single: Partition
    several: Partition | None
    single_probability: float


def partitions(
    units: Units, spread: float, usual: float, scatter: float | None = None
) -> Partitions:
    """Find the most probable partition.

    Args:
        units: in their order.
        spread: how far apart levels may be.
        usual: standard deviation between units of one level as it usually is.
        scatter: the same where it is known.
    """
    n = units.y.size
    typical = float(np.sqrt(np.median(units.variance)))
    scatters = [times * typical for times in _SCATTERS] if scatter is None else [scatter]
    one, each_own = np.zeros(n, np.int64), np.append(0, np.cumsum(units.kind > 0))
    begin = [_effects(units, one, units.variance), _effects(units, np.arange(n), units.variance)]

    def judged(state: Ints, tau: float) -> Partition:
        variance = units.variance + tau**2
        posterior, level = _log_posterior(units, state, variance, spread)
        posterior += _log_prior(units.kind, np.diff(state) > 0)
        if scatter is None:
            posterior -= (tau / usual) ** 2 / 2.0
        effects = _effects(units, level[state], variance)
        levels = _levels(units, level[state], variance, effects)[level]
        return Partition(state, levels, level, tau, effects, posterior)

    found: dict[bytes, Partition] = {}
    for tau in scatters:
        variance = units.variance + tau**2
        tried: set[bytes] = {one.tobytes(), each_own.tobytes()}
        for effects in begin if n > 1 else []:
            tried.add(_two_levels(units, variance, effects).tobytes())
            for probability in _CANDIDATES:
                for window in _WINDOWS:
                    tried |= _alternated(units, variance, window * spread, probability, effects)
        for key in tried:
            each = judged(np.frombuffer(key, np.int64), tau)
            if key not in found or each.log_posterior > found[key].log_posterior:
                found[key] = each
    single = found.pop(one.tobytes())
    several = max(found.values(), key=lambda each: each.log_posterior, default=None)
    best = single
    if several is not None and several.log_posterior > single.log_posterior:
        best = _sure(several, judged)
    found[one.tobytes()] = single
    logs = np.array([each.log_posterior for each in found.values()])
    probability = float(np.exp(single.log_posterior - np.logaddexp.reduce(logs)))
    several = best if best.states > 1 else several
    return Partitions(best, single, several, probability)


def _sure(best: Partition, judged: Callable[[Ints, float], Partition]) -> Partition:
    """The same without the changes that are not sure, the least of them first."""
    while best.states > 1:
        first = np.flatnonzero(np.diff(best.state)) + 1
        least = np.argsort(np.abs(np.diff(best.levels)), kind="stable")[:_LEAST_CHANGES]
        # each change alone, and both of a level, which lets its neighbours be one
        joints = [first[k : k + many] for k in least for many in (1, 2)]
        plainer = max(
            (judged(_joined(best.state, joint), best.scatter) for joint in joints),
            key=lambda each: each.log_posterior,
        )
        if plainer.log_posterior < best.log_posterior - _SURE:
            break
        best = plainer
    return best


def _joined(state: Ints, at: Ints) -> Ints:
    """The same states without the changes before these units."""
    changes = np.diff(state, prepend=0)
    changes[at] = 0
    return np.cumsum(changes)


def _alternated(
    units: Units, variance: Floats, spread: float, probability: float, effects: Floats
) -> set[bytes]:
    """Partitions of given effects, and effects of that partition, until nothing changes."""
    cost = np.full(units.y.size - 1, -2.0 * np.log(probability / (1.0 - probability)))
    cost[units.kind == 0] = _NEVER
    tried: set[bytes] = set()
    for _ in range(_ROUNDS):
        state = optimal_partition(units.y - units.x @ effects, 1.0 / variance, cost, spread)
        key = state.tobytes()
        if key in tried:
            break
        tried.add(key)
        effects = _effects(units, state, variance)
    return tried


def _levels_of(states: int) -> list[tuple[float, Ints]]:
    """Which level each state may have, (states,), with the logarithm of how probable that is."""
    own = np.arange(states)
    if states <= 2:
        return [(0.0, own)]
    back = [
        (_THIRD + _HALF, np.unique(np.where(own % 2 == which, -1, own), return_inverse=True)[1])
        for which in (0, 1)
    ]
    return [(_THIRD, own), (_THIRD, own % 2), *back]


def _two_levels(units: Units, variance: Floats, effects: Floats) -> Ints:
    """The states of two levels that take turns, given β: the parting with the least squares."""
    level = units.y - units.x @ effects
    order = np.argsort(level, kind="stable")
    weight = (1.0 / variance)[order]
    below, first = np.cumsum(weight)[:-1], np.cumsum(weight * level[order])[:-1]
    total, whole = below[-1] + weight[-1], first[-1] + weight[-1] * level[order[-1]]
    between = first**2 / below + (whole - first) ** 2 / (total - below)
    heavy = level > level[order[int(np.argmax(between))]]
    return np.append(0, np.cumsum((np.diff(heavy) != 0) & (units.kind > 0)))


def _sums(values: Floats, state: Ints) -> Floats:
    """Sum rows by state."""
    out = np.zeros((int(state.max()) + 1, *values.shape[1:]))
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


def _log_posterior(
    units: Units, state: Ints, variance: Floats, spread: float
) -> tuple[float, Ints]:
    """Of the partition, less its prior and up to a constant, and the level of each state."""
    weights, levels = zip(*_levels_of(int(state[-1]) + 1), strict=True)
    logs = np.array(weights)
    logs += [_log_of_units(units, level[state], variance, spread) for level in levels]
    return float(np.logaddexp.reduce(logs)), levels[int(np.argmax(logs))]


def _log_of_units(units: Units, state: Ints, variance: Floats, spread: float) -> float:
    """How probable the units are, levels and β integrated out; up to a constant."""
    gram, cross = _between(units, state, variance)
    whole, right = units.gram + gram, units.cross + cross
    effects = np.asarray(np.linalg.solve(whole, right), np.float64)
    weight = 1.0 / variance
    levels = _levels(units, state, variance, effects)
    left = units.y - units.x @ effects - levels[state]
    # β's own misfit is that of its normal equations, up to a constant
    misfit = float(weight @ left**2) + float(
        effects @ units.gram @ effects - 2.0 * effects @ units.cross
    )
    own = 1.0 / _sums(weight, state)
    logs = np.log(variance).sum() - np.log(2.0 * np.pi * own).sum()
    logs += float(np.linalg.slogdet(whole)[1])
    return -0.5 * (misfit + float(logs)) + _log_of_levels(levels, own, spread)


def _log_of_levels(level: Floats, variance: Floats, spread: float) -> float:
    """How probable levels are that are known with a variance each, all deviations alike."""
    if level.size == 1:
        return -float(np.log(spread))
    each = (_DEVIATIONS[:, None] * spread) ** 2 + variance
    total = (1.0 / each).sum(axis=1)
    mean = (level / each).sum(axis=1) / total
    misfit = ((level - mean[:, None]) ** 2 / each).sum(axis=1)
    logs = np.log(2.0 * np.pi * each).sum(axis=1) + np.log(total / (2.0 * np.pi))
    return float(np.logaddexp.reduce(-0.5 * (misfit + logs)) - np.log(spread * _DEVIATIONS.size))


def _log_prior(kind: Ints, changes: NDArray[np.bool_]) -> float:
    """No change as likely as some; then every rate of changes, and every choice of places.

    Where something else tells a change, the rate of changes is as likely as it is high, or what
    tells it has nothing to do with the level.
    """
    total = 0.0
    for each in np.unique(kind[kind > 0]):
        places, used = int((kind == each).sum()), int(changes[kind == each].sum())
        if each > 1:
            # ∫ 2 p pᵏ (1 - p)ⁿ⁻ᵏ dp, unless what moves there tells nothing
            by_rate = float(betaln(used + 2, places - used + 1)) - _HALF + np.log1p(-_TELLS_NOTHING)
            total += by_rate if used else float(np.logaddexp(by_rate, np.log(_TELLS_NOTHING)))
        elif used:
            # ∫ pᵏ (1 - p)ⁿ⁻ᵏ dp
            total += float(betaln(used + 1, places - used + 1)) + _HALF
        else:
            total += _HALF
    return total
