"""Manoeuvres, and the evidence for a change of load between them."""

import numpy as np

from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.fitted_stretches import (
    cache_on_samples,
    mark_stretch_ends,
    mark_stretch_starts,
)
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Floats, Ints, MotionSamples
from estimators.joint.unit_levels import (
    BY_IMPLEMENT,
    DUMPED,
    FILLED,
    HINTED,
    NAMED,
    RESTARTED,
    TURNED,
)


@cache_on_samples
def find_manoeuvre_of_stretches(motion: MotionSamples) -> Ints:
    """Manoeuvre of each stretch, (stretches,).

    A manoeuvre too short or too steady to determine a mass is merged with the one before it, or
    with the one after it if only the boundary before it has evidence of a load change.
    """
    manoeuvre_of_stretch = motion.manoeuvre_of_sample[mark_stretch_starts(motion.stretch_of_sample)]
    number, of = np.unique(manoeuvre_of_stretch, return_inverse=True)
    samples = np.bincount(of, weights=np.bincount(motion.stretch_of_sample[motion.is_fittable]))
    tells = samples >= min(
        count_rows_in_duration(
            LIMITS.informative_manoeuvre_s, motion.rate_hz, LIMITS.informative_manoeuvre_samples
        ),
        samples.max(),
    )
    # a manoeuvre cut by the start or end of a record while cruising does not determine a mass
    gained_m_s = find_speed_ranges_m_s(motion, of, number.size)
    tells &= gained_m_s >= LIMITS.informative_speed_share * float(np.median(gained_m_s[tells]))
    place = np.arange(number.size)
    before = np.maximum.accumulate(np.where(tells, place, -1))
    after = np.minimum.accumulate(np.where(tells, place, number.size)[::-1])[::-1]
    goes = np.where(before < 0, np.argmax(tells), before)
    group = motion.stretch_of_sample
    first, last = (np.flatnonzero(f(group)) for f in (mark_stretch_starts, mark_stretch_ends))
    for short in np.flatnonzero(~tells & (before >= 0) & (after < number.size)):
        left, here, right = (of == each for each in (before[short], short, after[short]))
        start, end = first[here][0], last[here][-1]
        sooner, later = (last[left][-1], start), (end, first[right][0])
        at_begin, at_end = (classify_load_change(motion, *span, *span) for span in (sooner, later))
        if at_begin > 1 and at_end == 1:
            goes[short] = after[short]
    return number[goes][of]


def find_speed_ranges_m_s(motion: MotionSamples, manoeuvre_of_stretch: Ints, count: int) -> Floats:
    """Range of the speeds of each manoeuvre, (manoeuvres,) in m/s.

    Args:
        motion: the samples.
        manoeuvre_of_stretch: (stretches,) manoeuvre of each stretch, from 0.
        count: number of manoeuvres.
    """
    used = np.flatnonzero(motion.is_fittable)
    of, speed = manoeuvre_of_stretch[motion.stretch_of_sample[used]], motion.speed[used]
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, of, speed)
    np.maximum.at(most, of, speed)
    return most - least


def find_manoeuvre_of_fitted_samples(motion: MotionSamples) -> Ints:
    """Manoeuvre of each fitted sample, (fitted samples,)."""
    return find_manoeuvre_of_stretches(motion)[motion.stretch_of_sample[motion.is_fittable]]


def classify_load_change_evidence(motion: MotionSamples) -> Ints:
    """Kind of evidence for a load change between successive manoeuvres, (manoeuvres - 1,).

    Returns:
        0 if the load cannot change, since the machine drove on, is stated to be empty or is known
        to carry one load; 1 if only the masses can show a change; `TURNED` at a change of
        direction; `RESTARTED` after a gap as between files; `HINTED` if boom or bucket moved,
        `DUMPED` if away from where they usually are; `FILLED` if the machine dug; `NAMED` at the
        start or end of the stated empty time.
    """
    used = np.flatnonzero(motion.is_fittable)
    first = np.flatnonzero(np.append(True, np.diff(find_manoeuvre_of_fitted_samples(motion)) > 0))
    last = np.append(first[1:], used.size) - 1
    # a boom may go up before the machine stands, and come down when it moves again
    middle = used[(first + last) // 2]
    spans = zip(used[last[:-1]], used[first[1:]], middle[:-1], middle[1:], strict=True)
    kind = np.array([classify_load_change(motion, *span) for span in spans], np.int64)
    # the bucket is in front: the machine arrives, fills or empties it, and backs out
    arrives, leaves = motion.direction[used[last[:-1]]], motion.direction[used[first[1:]]]
    backs_out = (kind == 1) & (arrives > 0.0) & (leaves < 0.0)
    seen = np.isin(kind, BY_IMPLEMENT).any()
    kind = np.where(backs_out & ~seen, TURNED, kind)
    return np.zeros_like(kind) if motion.has_single_load else kind


def classify_load_change(
    motion: MotionSamples, end_row: int, start_row: int, boom_begin_row: int, boom_end_row: int
) -> int:
    """Kind of evidence for a load change between two manoeuvres.

    Args:
        motion: samples, with arm angles and digging.
        end_row: last sample of the first manoeuvre.
        start_row: first sample of the second one.
        boom_begin_row: first sample at which boom and bucket are examined.
        boom_end_row: end of these samples.
    """
    if motion.is_digging is not None and motion.is_digging[end_row : start_row + 1].any():
        return FILLED
    if motion.empty is not None and motion.empty[end_row] != motion.empty[start_row]:
        return NAMED
    if motion.empty is not None and motion.empty[end_row]:
        return 0
    if (
        motion.earlier_stop_count is not None
        and motion.earlier_stop_count[end_row] == motion.earlier_stop_count[start_row]
    ):
        return 0
    span = slice(boom_begin_row, boom_end_row + 1)
    arms = motion.boom_and_bucket_angles_rad
    if any(compute_finite_range(arm[span]) > LIMITS.arm_movement_rad for arm in arms):
        away_rad = [
            np.abs(arm[boom_begin_row : start_row + 1] - usual_rad)
            for arm, usual_rad in zip(arms, find_usual_arm_angles_rad(motion), strict=True)
        ]
        arrival = end_row - boom_begin_row
        is_extended = any(
            np.nanmax(each[arrival:], initial=0.0)
            > np.nanmin(each[: arrival + 1], initial=np.inf) + LIMITS.arm_movement_rad
            for each in away_rad
        )
        return DUMPED if is_extended else HINTED
    silent = (
        motion.long_gap_count is not None
        and motion.long_gap_count[end_row] != motion.long_gap_count[start_row]
    )
    return RESTARTED if silent else 1


@cache_on_samples
def find_usual_arm_angles_rad(motion: MotionSamples) -> list[float]:
    """Median angle of boom and bucket while driving, each; NaN if it is not known."""
    driving = [arm[motion.is_fittable] for arm in motion.boom_and_bucket_angles_rad]
    known = [angle_rad[np.isfinite(angle_rad)] for angle_rad in driving]
    return [float(np.median(each)) if each.size else np.nan for each in known]


def compute_finite_range(values: Floats) -> float:
    """Maximum minus minimum of the finite values; 0 if there are none."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0
