"""Prior of changes whose rate is unknown: by the kind of their boundaries, and by their places.

A machine that hauls fills at one place and empties at another, and at the places between nothing
changes, whatever its driving direction does there. So where boundaries are at recurrent places,
each place may have a rate of its own.
"""

from itertools import combinations
from typing import Final

import numpy as np
from scipy.special import betaln

from estimators.arrays import Bools, Ints
from estimators.joint.joint_limits import LIMITS
from estimators.joint.unit_levels import NAMED, RESTARTED, UnitLevels

#: Log probabilities of two cases, and of three, of which each is as probable.
LOG_HALF: Final = float(np.log(0.5))
LOG_THIRD: Final = float(np.log(1.0 / 3.0))


def compute_log_prior_of_unknown_change_rate(change_kinds: Ints, has_change: Bools) -> float:
    """Log prior for which no change is as probable as some, and all rates are equally probable.

    At boundaries with other evidence of a change, either the probability of a rate is proportional
    to the rate, or the evidence is unrelated to the level. Separate records have one level in all,
    mostly one level each, or any rate of changes.
    """
    total = 0.0
    for each in np.unique(change_kinds[change_kinds > 0]):
        places, used = (
            int((change_kinds == each).sum()),
            int(has_change[change_kinds == each].sum()),
        )
        if each == RESTARTED:
            by_rate = float(np.exp(betaln(used + 1, places - used + 1)))
            one_each = (
                1.0 - LIMITS.same_level_probability
            ) ** used * LIMITS.same_level_probability ** (places - used)
            total += float(np.log(by_rate + (used == 0) + one_each)) + LOG_THIRD
        elif each > 1:
            # ∫ 2 p pᵏ (1 - p)ⁿ⁻ᵏ dp, unless the evidence is unrelated
            by_rate = (
                float(betaln(used + 2, places - used + 1))
                - LOG_HALF
                + np.log1p(-LIMITS.unrelated_hint_probability)
            )
            total += (
                by_rate
                if used
                else float(np.logaddexp(by_rate, np.log(LIMITS.unrelated_hint_probability)))
            )
        elif used:
            # ∫ pᵏ (1 - p)ⁿ⁻ᵏ dp
            total += float(betaln(used + 1, places - used + 1)) + LOG_HALF
        else:
            total += LOG_HALF
    return total


def compute_log_odds_of_changes_by_place(
    change_kinds: Ints, places: Ints, has_change: Bools
) -> float:
    """Log odds of the changes if recurrent places have rates of their own, or else kinds alone.

    Both are equally probable. One level has no changes to compare: its log odds are 0.

    Args:
        change_kinds: (n - 1,) kind of each boundary.
        places: (n - 1,) number of its recurrent place; 0 for none.
        has_change: (n - 1,) whether the level changes there.
    """
    apart = (change_kinds > 0) & (change_kinds < RESTARTED) & (places > 0)
    if not has_change.any() or not apart.any():
        return 0.0
    by_kind, rest = (
        compute_log_prior_of_unknown_change_rate(change_kinds[each], has_change[each])
        for each in (change_kinds != NAMED, (change_kinds != NAMED) & ~apart)
    )
    by_place = rest + sum(
        compute_log_prior_of_unknown_change_rate(change_kinds[here], has_change[here])
        for here in (apart & (places == each) for each in np.unique(places[apart]))
    )
    return float(np.logaddexp(LOG_HALF, LOG_HALF + by_place - by_kind))


def list_partitions_changing_at_places(units: UnitLevels) -> list[Ints]:
    """List the partitions that change at each boundary of one recurrent place, or of two."""
    if units.place is None:
        return []
    numbers = np.unique(units.place[(units.place > 0) & (units.kind > 0)])
    return [
        np.append(0, np.cumsum((units.kind > 0) & np.isin(units.place, some)))
        for some in (*((each,) for each in numbers), *combinations(numbers, 2))
    ]
