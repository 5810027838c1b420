"""Which load states are empty and which are loaded, and what each pass between two changes weighs.

A pass is a stretch of manoeuvres that are all loaded or all empty; states that differ by less than
loaded and empty do (spillage, a state split in two) are one pass.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Loaded and empty are told apart when their means lie so many deviations of a state apart.
_APART: Final = 4.0
#: A spread of fewer is that of the whole class.
_FEWEST: Final = 4
#: Standard deviation over the median absolute deviation of a normal distribution.
_MAD: Final = 1.4826
#: Starts that dig with nothing else between are one filling of the bucket, if no further apart.
ONE_FILLING_NS: Final = 60 * 10**9
#: Empty and loaded passes differ among themselves by at least these shares of a load: what is
#: carried back has a long tail, and so have loads.
_LEAST_LIGHT: Final = 0.05
_LEAST_HEAVY: Final = 0.1


@dataclass(frozen=True)
class Passes:
    """Passes in time.

    Attributes:
        of: (manoeuvres,) the pass of each.
        share: (manoeuvres,) the weight of each in its pass' mass; those of a pass add up to 1.
        loaded: (passes,).
        mass_kg: (passes,).
        u_kg: (passes,) what is random of it: manoeuvres' own noise and their scatter.
        start_ns: (passes,) first fitted sample.
        end_ns: (passes,) last fitted sample.
    """

    of: Ints
    share: Floats
    loaded: Bools
    mass_kg: Floats
    u_kg: Floats
    start_ns: Ints
    end_ns: Ints


def passes(loads: pl.DataFrame, manoeuvres: pl.DataFrame, digs: pl.DataFrame) -> Passes | None:
    """Join manoeuvres to passes; None where loaded and empty cannot be told apart.

    Args:
        loads: for the scatter.
        manoeuvres: states and masses.
        digs: `digging`: what comes before a start that digs is empty, what comes after is loaded.
    """
    if manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count():
        return None
    level = manoeuvres["mass_kg"].to_numpy()
    std = manoeuvres["mass_std_kg"].to_numpy()
    state = manoeuvres["load_id"].to_numpy()
    begin, end = (manoeuvres[name].to_numpy() for name in ("start_t_ns", "end_t_ns"))
    scatter_kg = float(loads["scatter_kg"].fill_null(0.0).max() or 0.0)  # pyright: ignore[reportArgumentType]
    weight = 1.0 / (std**2 + scatter_kg**2)
    total = np.bincount(state, weight)
    mass_kg = np.bincount(state, weight * level) / total
    loaded = _loaded(mass_kg, 1.0 / np.sqrt(total), _labels(mass_kg, state, begin, end, digs))
    if loaded is None:
        return None
    of_state = loaded[state]
    parts = np.diff(of_state) != 0
    parts[_filled_again(of_state, begin, end, digs)] = True
    of = np.cumsum(np.append(0, parts)).astype(np.int64)
    total = np.bincount(of, weight)
    first = np.flatnonzero(np.append(True, np.diff(of) > 0))
    last = np.append(first[1:] - 1, of.size - 1)
    return Passes(
        of,
        weight / total[of],
        of_state[first],
        np.bincount(of, weight * level) / total,
        1.0 / np.sqrt(total),
        begin[first],
        end[last],
    )


def _filled_again(loaded: Bools, begin: Ints, end: Ints, digs: pl.DataFrame) -> list[int]:
    """Places before which a loaded machine digs, so late that it was empty in between.

    No start tells of the empty drive: it was too short, or nothing was recorded.
    """
    found: list[int] = []
    last_ns = -ONE_FILLING_NS
    for start, stop in digs.select("start_t_ns", "end_t_ns").sort("start_t_ns").iter_rows():
        after = int(np.searchsorted(begin, start, "left"))
        if 0 < after < loaded.size and loaded[after - 1] and loaded[after]:
            empties = np.flatnonzero(~loaded[:after])
            first = int(empties[-1]) + 1 if empties.size else 0
            since_ns = max(int(begin[first]), last_ns)
            # what drives while it is seen to dig is no haul
            if start - since_ns > ONE_FILLING_NS and end[after - 1] <= start:
                found.append(after - 1)
        last_ns = stop
    return found


def _labels(mass_kg: Floats, state: Ints, begin: Ints, end: Ints, digs: pl.DataFrame) -> Ints:
    """(states,) 0 where a start that digs follows, 1 where one came before, -1 else."""
    label = np.full(mass_kg.size, -1)
    for start, stop in digs.select("start_t_ns", "end_t_ns").iter_rows():
        before = int(np.searchsorted(end, start, "right")) - 1
        after = int(np.searchsorted(begin, stop, "left"))
        if before < 0 or after >= state.size:
            continue
        empty, full = state[before], state[after]
        if mass_kg[full] > mass_kg[empty]:
            label[empty], label[full] = 0, 1
    return label


def _loaded(mass_kg: Floats, u_kg: Floats, label: Ints) -> Bools | None:
    """(states,) whether each is loaded: the side of a border between the two classes."""
    if mass_kg.size < 2:
        return None
    told = (label == 0).any() and (label == 1).any()
    border = _otsu(mass_kg)
    light, heavy = mass_kg <= border, mass_kg > border
    if told:
        light, heavy = label == 0, label == 1
    a, b = float(np.median(mass_kg[light])), float(np.median(mass_kg[heavy]))
    least_kg = float(np.median(u_kg))
    spread_kg = _spread(mass_kg[light], least_kg)
    if not b - a > _APART * max(least_kg, spread_kg if light.sum() >= _FEWEST else 0.0):
        return None
    low = max(spread_kg, _LEAST_LIGHT * (b - a))
    high = max(_spread(mass_kg[heavy], least_kg), _LEAST_HEAVY * (b - a))
    border = (a * high + b * low) / (low + high)
    return mass_kg > (_by_labels(mass_kg, label, border) if told else border)


def _by_labels(mass_kg: Floats, label: Ints, border: float) -> float:
    """The border that is at odds with the fewest labels, of several the one nearest to `border`."""
    order = np.sort(mass_kg)
    choices = np.append((order[1:] + order[:-1]) / 2.0, border)
    wrong = [
        int(np.sum((label == 0) & (mass_kg > choice)) + np.sum((label == 1) & (mass_kg <= choice)))
        for choice in choices
    ]
    best = choices[np.array(wrong) == min(wrong)]
    return float(best[np.argmin(np.abs(best - border))])


def _spread(values: Floats, least: float) -> float:
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
