"""Level of each unit of a series, such as the mass of a manoeuvre, given shared effects."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.joint.joint_limits import LIMITS
from estimators.numerics.autocorrelation import estimate_pooled_autocorrelation
from estimators.numerics.group_sums import GroupSums, NoiseMoments, compute_rms_scales_of_columns
from estimators.numerics.sandwich import compute_sandwich_meat

#: Kinds of boundaries with evidence of a change besides the units: the machine backs out of where
#: it drove to; a record ends and another begins; a hint (a boom movement); a better one (a boom
#: that is extended); near certainty (a filled bucket); a statement.
TURNED: Final = 2
RESTARTED: Final = 3
HINTED: Final = 4
DUMPED: Final = 5
FILLED: Final = 6
NAMED: Final = 7
#: Those of them that boom, bucket or digging show.
BY_IMPLEMENT: Final = (HINTED, DUMPED, FILLED)


@dataclass(frozen=True, slots=True)
class UnitLevels:
    """Levels of the units, and the information about the effects that all units share.

    Attributes:
        y: (n,) level of each unit if β is 0.
        x: (n, r) response of the level to β: y - x β is the level.
        variance: (n,) variance of y from the unit alone.
        gram: (r, r) information about β within units and from its prior.
        cross: (r,) right-hand side of the same equations.
        kind: (n - 1,) kind of each boundary: 0 no change possible, 1 a change that only the units
            indicate; `TURNED`, `RESTARTED`, `HINTED`, `DUMPED`, `FILLED` and `NAMED` have other
            evidence. Boundaries of a kind are exchangeable.
        place: (n - 1,) number of the recurrent place of each boundary, 0 for none; None if no place
            is known. Changes tend to be at all boundaries of a place or at none.
    """

    y: Floats
    x: Floats
    variance: Floats
    gram: Floats
    cross: Floats
    kind: Ints
    place: Ints | None = None


def estimate_unit_levels(
    A: Floats,
    f: Floats,
    group: Ints,
    noise: NoiseMoments | None,
    prior_mean: Floats,
    prior_std: Floats,
    unit_of_group: Ints,
) -> UnitLevels:
    """Reduce A θ = f to one first parameter per unit, with all others shared.

    Every unit has its own level, so changes between units leave no residual.

    Args:
        A: (n, p) columns.
        f: (n,) response.
        group: (n,) group of each sample, negative for none.
        noise: noise moments of the columns; None treats the columns as exact.
        prior_mean: (p - 1,) prior means of the shared parameters.
        prior_std: (p - 1,) prior standard deviations; inf for no prior.
        unit_of_group: (groups,) unit of each group, from 0.

    Returns:
        The units, with all boundaries of kind 1; NaN for a unit whose first column is 0.
    """
    used = group >= 0
    n = int(used.sum())
    f, scale = np.where(used, f, 0.0), compute_rms_scales_of_columns(A, group)
    A = A if used.all() else np.where(used[:, None], A, 0.0)
    sums = GroupSums.sum_products_by_group(A, f, group, noise, scale)
    of_group = np.zeros(f.size, np.int64)
    for part, number in zip(sums.rows, unit_of_group, strict=True):
        of_group[part] = number
    each = sums.sum_groups_by_unit(unit_of_group)
    precision = np.where(np.isfinite(prior_std), (prior_std * scale[1:]) ** -2.0, 0.0)
    clean, bare = each.grams - each.noise_gram, each.crosses - each.noise_cross
    # a unit whose acceleration is only noise has no information, instead of a negative amount
    own = np.maximum(clean[:, 0, 0], LIMITS.min_own_fraction * each.grams[:, 0, 0])
    kind = np.ones(own.size - 1, np.int64)
    if not (own > 0.0).all():
        nothing, r = np.full(own.size, np.nan), A.shape[1] - 1
        return UnitLevels(
            nothing, np.full((own.size, r), np.nan), nothing, np.zeros((r, r)), np.zeros(r), kind
        )
    y, x = bare[:, 0] / own, clean[:, 0, 1:] / own[:, None]
    within = (clean[:, 1:, 1:] - own[:, None, None] * x[:, :, None] * x[:, None, :]).sum(axis=0)
    cross = (bare[:, 1:] - (own * y)[:, None] * x).sum(axis=0)
    squares, vectors = np.linalg.eigh(within)
    within = (vectors * np.maximum(squares, 0.0)) @ vectors.T
    variance = float(f[used] @ f[used]) / n
    level, correlation, white = y, np.ones(1), variance
    # each of few units, as if it had effects of its own
    own_columns = (
        A[:, :1] if y.size >= LIMITS.shared_effect_units else A[:, np.abs(A).sum(axis=0) > 0.0]
    )
    for _ in range(LIMITS.noise_rounds):
        whole = within / variance + np.diag(precision)
        beta = np.linalg.lstsq(whole, cross / variance + precision * prior_mean * scale[1:])[0]
        level = y - x @ beta
        residual = f - A[:, 0] * (level[of_group] / scale[0]) - A[:, 1:] @ (beta / scale[1:])
        residual = np.where(used, residual, 0.0)
        correlation, _ = estimate_pooled_autocorrelation(residual, group, own_columns)
        white = float(residual @ residual) / max(n - level.size, 1)
        variance = white * max(2.0 * float(correlation.sum()) - 1.0, 1.0)
    first = np.ascontiguousarray(A[:, :1])
    sandwiched = sum(
        float(
            compute_sandwich_meat(
                first, group, int(group[part[0]]), int(part[0]), int(part[-1]), correlation
            )[0, 0]
        )
        for part in sums.rows
    )
    sandwiched /= scale[0] ** 2
    per_square = white * max(sandwiched / float(each.grams[:, 0, 0].sum()), 1.0)
    back = scale[1:]
    return UnitLevels(
        y / scale[0],
        x * back / scale[0],
        per_square * each.grams[:, 0, 0] / own**2 / scale[0] ** 2,
        (within / variance + np.diag(precision)) * np.outer(back, back),
        (cross / variance + precision * prior_mean * back) * back,
        kind,
    )
