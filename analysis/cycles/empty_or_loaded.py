"""Which load states are empty and which are loaded: by their masses, and by what was dug."""

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.cycles.cycle_limits import LIMITS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Standard deviation over the median absolute deviation of a normal distribution.
_MAD: Final = 1.4826


def loaded_states(
    mass_kg: Floats, u_kg: Floats, state: Ints, times_ns: tuple[Ints, Ints], digs: pl.DataFrame
) -> Bools | None:
    """(states,) whether each is loaded; None where that cannot be told.

    Args:
        mass_kg: (states,).
        u_kg: (states,) what is random of it.
        state: (manoeuvres,) the load state of each.
        times_ns: (manoeuvres,) when each begins, and ends.
        digs: `digging`: what comes before a start that digs is empty, what comes after is loaded.
    """
    return _classify_by_border(
        mass_kg, u_kg, _digging_labels(mass_kg, u_kg, state, *times_ns, digs)
    )


def _digging_labels(
    mass_kg: Floats, u_kg: Floats, state: Ints, begin: Ints, end: Ints, digs: pl.DataFrame
) -> Ints:
    """(states,) 0 where a start that digs follows, 1 where one came before, -1 else."""
    label = np.full(mass_kg.size, -1)
    for start, stop in digs.select("start_t_ns", "end_t_ns").iter_rows():
        before = int(np.searchsorted(end, start, "right")) - 1
        after = int(np.searchsorted(begin, stop, "left"))
        if before < 0 or after >= state.size:
            continue
        empty, full = state[before], state[after]
        apart = float(np.hypot(u_kg[full], u_kg[empty]))
        # a bucket is no lighter for what it digs
        if empty != full and mass_kg[full] > mass_kg[empty] - LIMITS.not_dug_std * apart:
            label[empty], label[full] = 0, 1
    return label


def _classify_by_border(mass_kg: Floats, u_kg: Floats, label: Ints) -> Bools | None:
    """(states,) whether each is loaded: the side of a border between the two classes.

    Loads that are less than a state's deviation have no such border: what was dug tells then, or
    that every state is heavier than both its neighbours or lighter.
    """
    if mass_kg.size < 2:
        return None
    told = (label == 0).any() and (label == 1).any()
    border = _otsu(mass_kg)
    light, heavy = mass_kg <= border, mass_kg > border
    if told:
        light, heavy = label == 0, label == 1
    a, b = float(np.median(mass_kg[light])), float(np.median(mass_kg[heavy]))
    least_kg = float(np.median(u_kg))
    spread_kg = _robust_std(mass_kg[light], least_kg)
    parted = b - a > LIMITS.class_distance_std * max(
        least_kg, spread_kg if light.sum() >= LIMITS.own_spread_min_states else 0.0
    )
    if not parted:
        # a load that changes without digging is dumped
        label = label if told else _alternating_labels(mass_kg)
        light, heavy = label == 0, label == 1
        return heavy if _class_means_differ(mass_kg[light], mass_kg[heavy], least_kg) else None
    low = max(spread_kg, LIMITS.min_empty_spread * (b - a))
    high = max(_robust_std(mass_kg[heavy], least_kg), LIMITS.min_loaded_spread * (b - a))
    border = (a * high + b * low) / (low + high)
    return mass_kg > (_border_by_labels(mass_kg, label, border) if told else border)


def _alternating_labels(mass_kg: Floats) -> Ints:
    """(states,) 1 where each is heavier than the one before, 0 where lighter; -1 without turns."""
    rises = np.diff(mass_kg) > 0.0
    turns = rises[1:] != rises[:-1]
    if not turns.size or float(turns.mean()) < LIMITS.alternating_min_fraction:
        return np.full(mass_kg.size, -1)
    return np.append(not rises[0], rises).astype(np.int64)


def _class_means_differ(light: Floats, heavy: Floats, least_kg: float) -> bool:
    """Whether the means of two classes of states differ, each of enough states to tell."""
    if min(light.size, heavy.size) < LIMITS.own_spread_min_states:
        return False
    variances = (_robust_std(each, least_kg) ** 2 / each.size for each in (light, heavy))
    return float(np.mean(heavy) - np.mean(light)) > LIMITS.digging_class_distance_std * float(
        np.sqrt(sum(variances))
    )


def _border_by_labels(mass_kg: Floats, label: Ints, border: float) -> float:
    """The border that is at odds with the fewest labels, of several the one nearest to `border`."""
    order = np.sort(mass_kg)
    choices = np.append((order[1:] + order[:-1]) / 2.0, border)
    wrong = [
        int(np.sum((label == 0) & (mass_kg > choice)) + np.sum((label == 1) & (mass_kg <= choice)))
        for choice in choices
    ]
    best = choices[np.array(wrong) == min(wrong)]
    return float(best[np.argmin(np.abs(best - border))])


def _robust_std(values: Floats, least: float) -> float:
    """Standard deviation by the median absolute deviation."""
    return max(_MAD * float(np.median(np.abs(values - np.median(values)))), least)


def _otsu(values: Floats) -> float:
    """The border that leaves the smallest sum of squares on both sides (Otsu 1979)."""
    order = np.sort(values)
    middles = (order[1:] + order[:-1]) / 2.0
    sums = [
        float(sum(np.var(part) * part.size for part in (order[:k], order[k:])))
        for k in range(1, order.size)
    ]
    return float(middles[int(np.argmin(sums))])
