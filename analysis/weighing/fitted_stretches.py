"""Stretches in which the equation of straight motion may be fitted, from the break-away on."""

import math
from collections.abc import Callable
from functools import wraps
from itertools import pairwise
from typing import TypeVar

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.schema import get_column_values
from analysis.model.settings import Settings
from analysis.model.windows import find_flagged_runs, flag_rows_near_flagged_rows
from analysis.stages.gating.gate import mark_possible_braking, mark_samples_for_pooling
from analysis.stages.gating.segments import assign_manoeuvre_numbers_to_samples
from analysis.stages.motion.phases import (
    count_rows_in_speed_rate_span,
    mark_samples_held_downhill,
    mark_speed_falls_beyond_noise,
    mark_stopping_samples,
)
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.weighing_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints
from estimators.interpreted import compiled_inline, compiled_with_array_form

T = TypeVar("T")
R = TypeVar("R")


def integrate_path_positions_and_length_m(
    speed: Floats, is_used: Bools, long_gap_count: Ints, rate_hz: float
) -> tuple[Floats, float]:
    """Position of the machine on its path, (n,), and the length of the path in m.

    Each record is centred on its own path, since motion between records is unknown.
    """
    place = np.cumsum(speed) / rate_hz
    length = 0.0
    for record in np.unique(long_gap_count[is_used]):
        mine = long_gap_count == record
        first, last = (float(edge(place[mine & is_used])) for edge in (np.min, np.max))
        place[mine] -= (first + last) / 2.0
        length = max(length, last - first)
    return np.where(np.abs(place) <= length, place, 0.0) / (length or 1.0), length


def count_standstills_so_far(excitation: pl.DataFrame) -> Ints:
    """Number of standstills so far, (n,); unknown motion counts as one."""
    stands = ~(excitation["phase"] != "standstill").fill_null(value=False).to_numpy()
    return count_runs_so_far(stands)


def mark_slow_parts_of_drives(speed: Floats, stop_count_of_sample: Ints) -> Bools:
    """Flags (n,) of samples in the slow parts between two fast parts of a drive.

    A load may change there on the move: under a chute, or while it is dumped. None is marked if
    the machine stops in each of them.

    Args:
        speed: (n,) in m/s.
        stop_count_of_sample: (n,) number of earlier stops.
    """
    size = np.abs(speed)
    top_m_s = float(np.quantile(size, LIMITS.driving_speed_quantile))
    pace = np.select([size > LIMITS.fast_1 * top_m_s, size < LIMITS.slow_1 * top_m_s], [1, -1], 0)
    paced = np.flatnonzero(pace)
    first = paced[np.flatnonzero(np.diff(pace[paced], prepend=0))]
    slow = np.zeros(speed.size, np.bool_)
    drives_on = False
    for start, end in pairwise(first[1:]):
        if pace[start] < 0:
            slow[start : paced[np.searchsorted(paced, end) - 1] + 1] = True
            drives_on |= stop_count_of_sample[start - 1] == stop_count_of_sample[end]
    return slow & drives_on


def count_runs_so_far(is_flagged: Bools, min_samples: int = 1) -> Ints:
    """Number of runs of at least `min_samples` flagged samples begun up to each sample, (n,)."""
    first, last = find_flagged_runs(is_flagged)
    begun = np.zeros(is_flagged.size, np.int64)
    begun[first[last - first + 1 >= min_samples]] = 1
    return np.cumsum(begun)


def number_manoeuvres_and_split_long_drives(stop_count_of_sample: Ints, max_samples: int) -> Ints:
    """Number the manoeuvres, (n,), and split drives of twice `max_samples` samples or more."""
    cuts = np.append(True, stop_count_of_sample[1:] != stop_count_of_sample[:-1])
    drive_starts = np.flatnonzero(cuts)
    for first, end in zip(
        drive_starts, np.append(drive_starts[1:], stop_count_of_sample.size), strict=True
    ):
        cuts[np.arange(first + max_samples, end - max_samples + 1, max_samples)] = True
    return (np.cumsum(cuts) - 1 + stop_count_of_sample[0]).astype(np.int64)


def assign_fitted_manoeuvre_numbers(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    machine: Machine,
    moving_threshold_m_s: float,
    noise_m_s: float,
    *,
    includes_braking: bool,
) -> Ints:
    """Number of the manoeuvre of each sample that may be fitted, (n,); -1 elsewhere.

    It must be straight driving in a manoeuvre with an accepted window.
    """
    settings = machine.settings
    without = settings.gate.exclude_braking or not includes_braking
    accepted = mark_samples_for_pooling(excitation, gated, settings)
    manoeuvre_of_sample = assign_manoeuvre_numbers_to_samples(excitation, settings)
    informative = np.unique(manoeuvre_of_sample[accepted & (manoeuvre_of_sample >= 0)])
    phase = excitation["phase"]
    driving = phase.is_in(["accelerating", "cruising", "braking"]).fill_null(False).to_numpy()
    if without:
        brakes = (phase == "braking").fill_null(False).to_numpy()
        stands = (phase == "standstill").fill_null(False).to_numpy()
        speed = get_column_values(excitation, "speed_x_m_s")
        brakes &= mark_speed_falls_beyond_noise(speed, noise_m_s, settings)
        brakes |= mark_stopping_samples(speed, stands, moving_threshold_m_s, settings)
        brakes |= mark_samples_held_downhill(excitation, settings)
        driving &= ~mark_possible_braking(brakes, settings)
    return np.where(
        driving & np.isin(manoeuvre_of_sample, informative), manoeuvre_of_sample, -1
    ).astype(np.int64)


def find_manoeuvre_direction_of_samples(manoeuvre_of_sample: Ints, speed: Floats) -> Floats:
    """Sign of the mean speed of each manoeuvre, (n,); 1 elsewhere."""
    used = manoeuvre_of_sample >= 0
    ids, index = np.unique(manoeuvre_of_sample[used], return_inverse=True)
    total = np.bincount(index, weights=speed[used], minlength=ids.size)
    out = np.ones(manoeuvre_of_sample.size)
    out[used] = np.where(total >= 0, 1.0, -1.0)[index]
    return out


def cache_on_samples(compute: Callable[[T], R]) -> Callable[[T], R]:
    """Compute a result once per samples object, and cache it on the object."""
    name = compute.__name__

    @wraps(compute)
    def look_up(samples: T) -> R:
        if name not in vars(samples):
            vars(samples)[name] = compute(samples)
        return vars(samples)[name]

    return look_up


def mark_stretch_starts(stretch_of_sample: Ints) -> Bools:
    """Whether each sample is the first of its stretch, (n,)."""
    return (stretch_of_sample >= 0) & (np.append(-1, stretch_of_sample[:-1]) != stretch_of_sample)


def mark_stretch_ends(stretch_of_sample: Ints) -> Bools:
    """Whether each sample is the last of its stretch, (n,)."""
    return (stretch_of_sample >= 0) & (np.append(stretch_of_sample[1:], -1) != stretch_of_sample)


def compute_index_in_stretch(stretch_of_sample: Ints) -> Ints:
    """Number of earlier samples in the same stretch, (n,)."""
    row = np.arange(stretch_of_sample.size)
    return row - np.maximum.accumulate(np.where(mark_stretch_starts(stretch_of_sample), row, 0))


def find_stretch_spans(stretch_of_sample: Ints) -> Ints:
    """First sample of each stretch, and the one after its last, (stretches, 2)."""
    first, last = (
        np.flatnonzero(of(stretch_of_sample)) for of in (mark_stretch_starts, mark_stretch_ends)
    )
    return np.column_stack([first, last + 1])


def split_stretches_at_manoeuvres(stretch_of_sample: Ints, manoeuvre_of_sample: Ints) -> Ints:
    """Split stretches at manoeuvre borders and number them again, (n,)."""
    used = stretch_of_sample >= 0
    cut = used & (
        mark_stretch_starts(stretch_of_sample)
        | np.append(False, manoeuvre_of_sample[1:] != manoeuvre_of_sample[:-1])
    )
    return np.where(used, np.cumsum(cut) - 1, -1).astype(np.int64)


def extend_manoeuvres_to_break_away(
    manoeuvre_of_sample: Ints,
    speed: Floats,
    moving_threshold_m_s: float,
    max_extension_rows: int,
    skipped_rows: int,
) -> Ints:
    """Extend manoeuvres, (n,), backwards by at most `max_extension_rows` to the start of motion.

    Motion starts where the speed leaves the noise; the first `skipped_rows` rows of each extended
    manoeuvre stay -1.
    """
    smooth = np.abs(average_three_speed_samples(speed)) > moving_threshold_m_s
    grown = manoeuvre_of_sample.copy()
    for start in np.flatnonzero(mark_stretch_starts(manoeuvre_of_sample)):
        first = int(start)
        while (
            first > 0
            and start - first < max_extension_rows
            and smooth[first - 1]
            and manoeuvre_of_sample[first - 1] < 0
        ):
            first -= 1
        if first < start:
            grown[first:start] = manoeuvre_of_sample[start]
            grown[first : first + skipped_rows] = -1
    return grown


def assign_one_way_run_numbers(
    manoeuvre_of_sample: Ints, speed: Floats, reversal_margin_rows: int
) -> Ints:
    """Number the runs in one direction, (n,), -1 elsewhere: friction reverses with the motion."""
    used = manoeuvre_of_sample >= 0
    forwards = average_three_speed_samples(speed) > 0.0
    turns = np.append(False, (forwards[1:] != forwards[:-1]) & used[1:] & used[:-1])
    near = flag_rows_near_flagged_rows(turns, reversal_margin_rows, reversal_margin_rows + 1)
    manoeuvre_of_sample = np.where(used & ~near, 2 * manoeuvre_of_sample + forwards, -1)
    return np.where(
        manoeuvre_of_sample >= 0, np.cumsum(mark_stretch_starts(manoeuvre_of_sample)) - 1, -1
    ).astype(np.int64)


def clear_stretch_numbers_at_noise_speed(
    stretch_of_sample: Ints, speed: Floats, noise_m_s: float
) -> Ints:
    """Stretch of each sample, (n,); -1 for stretches whose speed never exceeds the noise.

    If the noise is below the motion threshold, slow samples count as motion.
    """
    used = stretch_of_sample >= 0
    if noise_m_s <= LIMITS.moving_speed_m_s or not used.any():
        return stretch_of_sample
    first = np.flatnonzero(mark_stretch_starts(stretch_of_sample))
    fastest = np.maximum.reduceat(
        np.where(used, np.abs(average_three_speed_samples(speed)), 0.0), first
    )
    moves = fastest > noise_m_s
    return np.where(used & moves[stretch_of_sample], stretch_of_sample, -1)


def average_three_speed_samples(speed: Floats) -> Floats:
    """Mean of each sample and its two neighbours, (n,) in m/s."""
    return np.convolve(speed, np.ones(3) / 3.0, "same")


def read_gear_ratio(aligned: pl.DataFrame) -> Floats | None:
    """Gear ratio without its sign, (n,); None without one.

    In neutral and during a gear change there is none: the ratio of the gear before is kept.
    """
    if "gear_ratio_1" not in aligned.columns:
        return None
    ratio = pl.col("gear_ratio_1").abs()
    known = aligned.select(
        pl.when(ratio > 0.0).then(ratio).fill_nan(None).forward_fill().backward_fill()
    ).to_series()
    return None if known.is_empty() or known.null_count() else known.to_numpy()


def mark_gear_changes(aligned: pl.DataFrame, ratio: Floats | None, rate_hz: float) -> Bools:
    """Whether the gear of `read_gear_ratio` changes or may have changed at each sample, (rows,)."""
    changes = np.zeros(aligned.height, np.bool_)
    if ratio is None:
        return changes
    step = count_rows_in_duration(LIMITS.gear_change_s, rate_hz)
    changes[step:] = np.abs(np.log(ratio[step:] / ratio[:-step])) > LIMITS.gear_step_log
    gear = aligned.get_column("gear_ratio_1").fill_nan(None)
    is_between_gears = gear.is_null() & (gear.forward_fill() != gear.backward_fill())
    return changes | is_between_gears.fill_null(value=False).to_numpy()


def mark_rows_without_data(aligned: pl.DataFrame) -> Bools:
    """Mark the grid rows without information, (n,)."""
    if "left_out" not in aligned.columns:
        return np.zeros(aligned.height, np.bool_)
    return aligned["left_out"].to_numpy()


def mark_rows_from_dig_to_standstill(
    aligned: pl.DataFrame, excitation: pl.DataFrame, speed: Floats, settings: Settings
) -> Bools:
    """Mark the rows from a digging start until the machine stands or turns back, (n,).

    The pile takes a part of the force and slows the machine. If braking counts as driving, a
    manoeuvre can be as long as the log, so the gate alone does not exclude these rows. A machine
    stopped by a pile lurches forwards as its bucket is lifted: the lurch is marked as well, with
    the standstill before it, so that the load changes where the machine digs.

    Args:
        aligned: grid, with `digs` if known.
        excitation: frame with the phases of motion.
        speed: (n,) in m/s.
        settings: settings with the speed of a stand, and the delay of the phase.
    """
    if "digs" not in aligned.columns or not aligned["digs"].any():
        return np.zeros(aligned.height, np.bool_)
    row = np.arange(speed.size)
    digs, margin = aligned["digs"].to_numpy(), count_rows_in_speed_rate_span(settings)
    moves = np.abs(speed) > settings.phases.standstill_speed_m_s
    way = np.sign(speed)[np.maximum.accumulate(np.where(moves, row, 0))]
    stands = count_standstills_so_far(excitation)
    ends = np.append(True, (way[1:] != way[:-1]) | (stands[1:] != stands[:-1]))
    last_dig, last_end = (np.maximum.accumulate(np.where(rows, row, -1)) for rows in (digs, ends))
    digs = last_dig >= last_end
    move = np.cumsum(ends) - 1
    path_m = np.bincount(move, np.abs(np.nan_to_num(speed))) / settings.align.rate_hz
    in_pile, way_of_move = np.bincount(move, digs) > 0.0, way[ends]
    lurches = np.zeros(path_m.size, np.bool_)
    is_short = (path_m < LIMITS.lurch_m) & (np.bincount(move, moves) > 0.0)
    for each in np.flatnonzero(is_short[1:]) + 1:
        lurches[each] = in_pile[each - 1] and way_of_move[each] == way_of_move[each - 1]
        in_pile[each] |= lurches[each]
    lurch = lurches[move]
    return lurch | flag_rows_near_flagged_rows(digs | (lurch & moves), margin + 1)


def make_centred_ramp(sample_count: int) -> Floats:
    """Evenly spaced values from -1/2 to 1/2, (samples,)."""
    return np.arange(sample_count) / max(sample_count, 1) - 0.5


def advance_signal_by_delay(signal: Floats, stretch_of_sample: Ints, delay_rows: float) -> Floats:
    """Signal (n,) advanced by cubic interpolation in each stretch.

    Linear interpolation would low-pass it on a slow grid.

    Args:
        signal: (n,) the signal, finite.
        stretch_of_sample: (n,) stretch of each sample, negative for none.
        delay_rows: delay in samples.
    """
    if not delay_rows:
        return signal
    return _interpolate_later_samples(signal, stretch_of_sample, float(delay_rows))


def _interpolate_later_samples_vectorised(
    signal: Floats, stretch_of_sample: Ints, delay_rows: float
) -> Floats:
    whole = math.floor(delay_rows)
    first, end = max(1 - whole, 0), min(signal.size - 2 - whole, signal.size)
    moved, by_cubic = np.empty(signal.size), np.zeros(signal.size, np.bool_)
    if delay_rows != whole and first < end:
        from_row = first + whole - 1
        moved[first:end] = sum(
            weight * signal[from_row + k : from_row + k + end - first]
            for k, weight in enumerate(_compute_cubic_weights(delay_rows - whole))
        )
        own = stretch_of_sample[first:end]
        inside = own >= 0
        for row in (from_row, from_row + 3):
            inside &= stretch_of_sample[row : row + end - first] == own
        by_cubic[first:end] = inside
    by_line = np.flatnonzero(~by_cubic)
    moved[by_line] = np.interp(
        by_line + delay_rows, np.arange(signal.size, dtype=np.float64), signal
    )
    return moved


@compiled_inline
def _compute_cubic_weights(part: float) -> tuple[float, float, float, float]:
    """Weights of four samples for a place between the middle ones, at a fraction of their step."""
    return (
        -part * (part - 1.0) * (part - 2.0) / 6.0,
        (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0,
        -(part + 1.0) * part * (part - 2.0) / 2.0,
        (part + 1.0) * part * (part - 1.0) / 6.0,
    )


@compiled_with_array_form(_interpolate_later_samples_vectorised)
def _interpolate_later_samples(
    signal: Floats, stretch_of_sample: Ints, delay_rows: float
) -> Floats:
    """Signal (n,) at a delay after each sample: by a cubic in a stretch, by a line elsewhere."""
    n, whole, moved = signal.size, math.floor(delay_rows), np.empty(signal.size)
    w0, w1, w2, w3 = _compute_cubic_weights(delay_rows - whole)
    for k in range(n):
        row, own = k + whole, stretch_of_sample[k]
        is_inside = own >= 0 and delay_rows != whole and row >= 1 and row + 2 < n
        if is_inside and stretch_of_sample[row - 1] == own and stretch_of_sample[row + 2] == own:
            total = 0.0 + w0 * signal[row - 1] + w1 * signal[row]
            moved[k] = total + w2 * signal[row + 1] + w3 * signal[row + 2]
            continue
        place = min(max(k + delay_rows, 0.0), n - 1.0)
        at = int(place)
        moved[k] = signal[at]
        if place > at:
            moved[k] += (signal[at + 1] - signal[at]) * (place - at)
    return moved
