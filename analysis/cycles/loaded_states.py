"""Classification of load states as loaded or empty, and of passes whose load falls."""

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.weighing.fit_columns import mark_plausible_masses
from estimators.arrays import Bools, Floats, Ints


def classify_loaded_states(
    mass_kg: Floats,
    u_kg: Floats,
    state: Ints,
    times_ns: tuple[Ints, Ints],
    digging: pl.DataFrame,
    is_empty: Bools | None = None,
) -> Bools | None:
    """Whether each state is loaded, (states,); None if undecidable.

    Args:
        mass_kg: (states,) mass of each state.
        u_kg: (states,) random uncertainty of each mass.
        state: (manoeuvres,) load state of each manoeuvre.
        times_ns: (manoeuvres,) starts, and ends.
        digging: the frame `digging`; the machine is empty before a digging start and loaded after.
        is_empty: (states,) whether the fit takes each as empty, if it tells any.
    """
    possible = mark_plausible_masses(mass_kg)
    kg, u = mass_kg[possible], u_kg[possible]
    label = label_state_loaded_by_digging(mass_kg, u_kg, state, *times_ns, digging)
    found = [classify_loaded_by_threshold(kg, u, label[possible])]
    told = np.zeros(0, np.bool_) if is_empty is None else is_empty[possible]
    if digging.is_empty() and told.any() and not told.all():
        found.append(classify_loaded_by_empty_states(kg, u, told))
    # a state with an implausible mass is classified like the one before it
    whole = [each[(np.cumsum(possible) - 1).clip(0)] for each in found if each is not None]
    # a body that always keeps a rest is never as light as the empty one; the table decides a tie
    return max(
        reversed(whole), key=lambda loaded: find_ends_of_hauls(loaded[state]).size, default=None
    )


def find_ends_of_hauls(is_loaded: Bools) -> Ints:
    """Indices of the loaded manoeuvres, (manoeuvres,), that one without a load follows."""
    return np.flatnonzero(is_loaded[:-1] & ~is_loaded[1:])


def classify_loaded_by_empty_states(mass_kg: Floats, u_kg: Floats, is_empty: Bools) -> Bools:
    """Classify each state as loaded if it is heavier than the empty ones by more than a rest."""
    empty_kg = float(np.median(mass_kg[is_empty]))
    spread_kg = estimate_robust_std(mass_kg[is_empty], float(np.median(u_kg)))
    rest_kg = LIMITS.rest_max_fraction * (float(np.median(mass_kg[~is_empty])) - empty_kg)
    noise_kg = LIMITS.class_distance_std * np.maximum(u_kg, spread_kg)
    return (mass_kg - empty_kg > np.maximum(noise_kg, rest_kg)) & ~is_empty


def label_state_loaded_by_digging(
    mass_kg: Floats, u_kg: Floats, state: Ints, start_ns: Ints, end_ns: Ints, digging: pl.DataFrame
) -> Ints:
    """Label of each state, (states,): 0 if a digging start follows, 1 if one precedes, else -1."""
    label = np.full(mass_kg.size, -1)
    # a manoeuvre that digs is empty if most of it is before the digging
    middle_ns = (start_ns + end_ns) // 2
    for after in find_manoeuvres_after_digging(middle_ns, digging).tolist():
        before = after - 1
        if before < 0 or after >= state.size:
            continue
        empty, full = state[before], state[after]
        apart = float(np.hypot(u_kg[full], u_kg[empty]))
        # digging cannot make the machine lighter
        if empty != full and mass_kg[full] > mass_kg[empty] - LIMITS.not_dug_std * apart:
            label[empty], label[full] = 0, 1
    return label


def classify_loaded_by_threshold(mass_kg: Floats, u_kg: Floats, loaded_label: Ints) -> Bools | None:
    """Classify each state as loaded or not, (states,), by a threshold of the mass; None if unclear.

    If loads are small compared with the scatter of the masses, the classes are those by digging, or
    by the alternation of nearly all masses between lighter and heavier.
    """
    if mass_kg.size < 2:
        return None
    told = (loaded_label == 0).any() and (loaded_label == 1).any()
    border = find_threshold_between_medians(mass_kg)
    light, heavy = mass_kg <= border, mass_kg > border
    if told:
        light, heavy = loaded_label == 0, loaded_label == 1
    a, b = float(np.median(mass_kg[light])), float(np.median(mass_kg[heavy]))
    least_kg = float(np.median(u_kg))
    spread_kg = estimate_robust_std(mass_kg[light], least_kg)
    parted = b - a > LIMITS.class_distance_std * max(
        least_kg, spread_kg if light.sum() >= LIMITS.own_spread_min_states else 0.0
    )
    if not parted:
        # without digging, use the alternation of the masses
        loaded_label = loaded_label if told else label_state_loaded_by_alternation(mass_kg)
        light, heavy = loaded_label == 0, loaded_label == 1
        if not do_class_means_differ(mass_kg[light], mass_kg[heavy], least_kg):
            return None
        # a state without a label, between others, is classified by its mass
        undug = (loaded_label < 0) & (mass_kg > (a + b) / 2.0)
        undug[[0, -1]] = False
        return heavy | undug
    low = max(spread_kg, LIMITS.min_empty_spread * (b - a))
    high = max(estimate_robust_std(mass_kg[heavy], least_kg), LIMITS.min_loaded_spread * (b - a))
    border = (a * high + b * low) / (low + high)
    return mass_kg > (fit_loaded_threshold_kg(mass_kg, loaded_label, border) if told else border)


def label_state_loaded_by_alternation(mass_kg: Floats) -> Ints:
    """1 if heavier than the state before, 0 if lighter, (states,); -1 if they do not alternate."""
    rises = np.diff(mass_kg) > 0.0
    turns = rises[1:] != rises[:-1]
    by_chance = 2.0 * turns.size / 3.0
    std = np.sqrt((16.0 * mass_kg.size - 29.0) / 90.0)
    least = min(
        LIMITS.alternating_min_fraction * turns.size, by_chance + LIMITS.alternating_std * std
    )
    if not turns.size or np.count_nonzero(turns) < least:
        return np.full(mass_kg.size, -1)
    return np.append(not rises[0], rises).astype(np.int64)


def do_class_means_differ(light_kg: Floats, heavy_kg: Floats, min_spread_kg: float) -> bool:
    """Whether the means of two classes differ significantly, with enough states in each."""
    if min(light_kg.size, heavy_kg.size) < LIMITS.own_spread_min_states:
        return False
    variances = (
        estimate_robust_std(each, min_spread_kg) ** 2 / each.size for each in (light_kg, heavy_kg)
    )
    return float(np.mean(heavy_kg) - np.mean(light_kg)) > LIMITS.digging_class_distance_std * float(
        np.sqrt(sum(variances))
    )


def fit_loaded_threshold_kg(mass_kg: Floats, loaded_label: Ints, initial_kg: float) -> float:
    """Threshold in kg between empty and loaded that contradicts the fewest labels (states,).

    Among equally good thresholds, the one nearest to `initial_kg`.
    """
    order = np.sort(mass_kg)
    choices = np.append((order[1:] + order[:-1]) / 2.0, initial_kg)
    wrong = [int(np.sum(loaded_label == np.where(mass_kg > choice, 0, 1))) for choice in choices]
    best = choices[np.array(wrong) == min(wrong)]
    return float(best[np.argmin(np.abs(best - initial_kg))])


def estimate_robust_std(values: Floats, min_std: float) -> float:
    """Standard deviation from the median absolute deviation, at least `min_std`."""
    return max(STD_OF_MAD * float(np.median(np.abs(values - np.median(values)))), min_std)


def find_threshold_between_medians(values: Floats) -> float:
    """Threshold that minimises the sum of distances to the medians of both classes.

    With squared distances (Otsu 1979), two masses far above all others would form a class.
    """
    order = np.sort(values)
    middles = (order[1:] + order[:-1]) / 2.0
    sums = [
        float(sum(np.abs(part - np.median(part)).sum() for part in (order[:k], order[k:])))
        for k in range(1, order.size)
    ]
    return float(middles[int(np.argmin(sums))])


def mark_rests_of_loads_by_mass(
    is_loaded: Bools,
    mass_and_u_kg: tuple[Floats, Floats],
    start_ns: Ints,
    end_ns: Ints,
    digging: pl.DataFrame,
) -> Bools:
    """Mark the manoeuvres that carry the rest of a load dumped in parts, (manoeuvres,).

    For a log whose boom shows no dumps: a load that loses more than any spillage has been dumped
    in part, and its rest does not count as another load.

    Args:
        is_loaded: (manoeuvres,) whether each is loaded.
        mass_and_u_kg: (manoeuvres,) mass of the load state of each, and its random uncertainty.
        start_ns: (manoeuvres,) start of each.
        end_ns: (manoeuvres,) end of each.
        digging: the frame `digging`.
    """
    rests = np.zeros(is_loaded.size, np.bool_)
    mass_kg, u_kg = mass_and_u_kg
    if is_loaded.all() or not is_loaded.any():
        return rests
    empty_kg = float(np.median(mass_kg[~is_loaded]))
    begins = is_loaded.copy()
    begins[1:] &= ~is_loaded[:-1]
    dug_after = find_manoeuvres_after_digging((start_ns + end_ns) // 2, digging)
    begins[dug_after[dug_after < begins.size]] = True
    haul = np.cumsum(begins)
    for number in np.unique(haul[is_loaded]):
        inside = np.flatnonzero(haul == number)
        loaded = inside[is_loaded[inside]]
        heaviest = loaded[np.argmax(mass_kg[loaded])]
        payload_kg = mass_kg[heaviest] - empty_kg
        # a rest may be so light that it is taken for the empty machine
        carries = is_loaded | (mass_kg - empty_kg > LIMITS.spilled_max_fraction * payload_kg)
        last = inside[carries[inside]][-1]
        apart_kg = LIMITS.other_load_std * float(np.hypot(u_kg[heaviest], u_kg[last]))
        most_kg = max(apart_kg, LIMITS.spilled_max_fraction * payload_kg)
        if mass_kg[heaviest] - mass_kg[last] > most_kg:
            whole = loaded[mass_kg[loaded] > mass_kg[heaviest] - apart_kg]
            rests[loaded[loaded > whole[-1]]] = True
    return rests


def find_manoeuvres_after_digging(middle_ns: Ints, digging: pl.DataFrame) -> Ints:
    """First manoeuvre after each digging start, (digging starts,), by the manoeuvres' middles."""
    dug_ns = (digging["start_t_ns"].to_numpy() + digging["end_t_ns"].to_numpy()) // 2
    return np.searchsorted(middle_ns, dug_ns)


def find_falling_passes(
    has_load: Bools,
    is_loaded: Bools,
    pass_of_manoeuvre: Ints,
    state: Ints,
    mass_kg: Floats,
    u_kg: Floats,
) -> tuple[int, ...]:
    """Find loaded passes whose load falls on the way by more than is spilled.

    A part of it was dropped, or the load was exchanged for a lighter one: the mass does not tell.

    Args:
        has_load: (manoeuvres,) whether the load of each is known and plausible.
        is_loaded: (manoeuvres,) whether each is loaded.
        pass_of_manoeuvre: (manoeuvres,) pass of each.
        state: (manoeuvres,) load state of each.
        mass_kg: (states,) mass of each state.
        u_kg: (states,) random uncertainty of each mass.
    """
    empties = state[has_load & ~is_loaded]
    if not empties.size:
        return ()
    empty_kg = float(np.median(mass_kg[empties]))
    found: list[int] = []
    for number in np.unique(pass_of_manoeuvre[has_load & is_loaded]).tolist():
        states = state[has_load & is_loaded & (pass_of_manoeuvre == number)]
        before_kg = np.maximum.accumulate(mass_kg[states])
        spilled_kg = LIMITS.spilled_max_fraction * (before_kg - empty_kg)
        noise_kg = LIMITS.other_load_std * np.hypot(u_kg[states], u_kg[states].max())
        if (before_kg - mass_kg[states] > np.maximum(spilled_kg, noise_kg)).any():
            found.append(number)
    return tuple(found)
