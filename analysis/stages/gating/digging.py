"""Digging starts: starts against a growing resistance, as when a bucket is driven into a pile.

Part of their force acts against the pile, and the bucket fills meanwhile, so they give no estimate
of a mass; together they would bias the terms that all starts share. A resistance that is constant
from the beginning (soft ground, a slope without a pitch) does not count, only one that grows.

Hills, gears, springs and gravity make resistances grow as well. But such resistances fall as often,
or grow in both directions of travel, and the machine drives on; a pile never pushes, lies in front
of the bucket, ends in a standstill or a reversal, and is not entered at road speed. The setting for
machines without a bucket is `machine.digs = false`.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.model.axes import X, make_regressor_and_force
from analysis.model.machine import Machine
from analysis.model.schema import build_frame
from analysis.model.settings import Settings
from analysis.model.windows import find_flagged_runs
from analysis.stages.gating.gate import reject_windows_with_excluded_rows
from analysis.stages.motion.phases import count_rows_in_speed_rate_span
from analysis.stages.stage_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints


def find_digging_starts(excitation: pl.DataFrame, machine: Machine) -> pl.DataFrame:
    """Find starts with growing resistance: F = m·a + b·v + c + d·max(0, t - t₀) with d > 0.

    A start lasts as long as the force drives, even if the pile slows the machine down. Mass,
    friction and constant have wide priors, so that a short start with an even acceleration, which
    a heavy machine could make as well, is not mistaken for digging.

    Args:
        excitation: frame with force, regressor, speed and phases.
        machine: machine file with settings, and empty mass if known.

    Returns:
        `digging`: a row per digging start.
    """
    met = find_starts_with_changed_resistance(excitation, machine) if machine.machine.digs else []
    found = [each.row for each in select_pile_contacts(met)]
    names = ("start_t_ns", "end_t_ns", "growth_N", "growth_std_N")
    columns = zip(*found, strict=True) if found else ([],) * len(names)
    return build_frame(
        "digging", {n: pl.Series(list(c)) for n, c in zip(names, columns, strict=True)}
    )


@dataclass(frozen=True, slots=True)
class _PileContact:
    """A start during which the resistance changes significantly.

    Attributes:
        row: row of `digging`: first and last sample in ns, growth and its standard deviation in N.
        way: direction of travel: 1 forwards, -1 in reverse.
        stops: whether a standstill, a reversal or the end of the log follows, and the speed before
            it was one at which piles are entered.
    """

    row: tuple[int, int, float, float]
    way: int
    stops: bool


def find_starts_with_changed_resistance(
    excitation: pl.DataFrame, machine: Machine
) -> list[_PileContact]:
    """Starts whose resistance changes significantly and by as much as a pile's, in time order."""
    A, force = make_regressor_and_force(X, excitation, machine.settings)
    acceleration, speed = A[:, 0], A[:, 1]
    driving = excitation["phase"].is_in(["accelerating", "cruising"]).fill_null(False).to_numpy()
    slowing = (excitation["phase"] == "braking").fill_null(False).to_numpy()
    whole = np.isfinite(A).all(axis=1) & np.isfinite(force)
    driving &= whole
    t_ns = excitation["t_ns"].to_numpy()
    found: list[_PileContact] = []
    # without any force there is no digging
    if (
        np.count_nonzero(driving) >= LIMITS.start_min_samples
        and (largest_N := find_robust_maximum_force(force[driving])) > 0.0
    ):
        fastest = find_robust_maximum_force(speed[driving])
        drive_N = np.sign(speed) * force
        against = slowing & whole & (drive_N > LIMITS.slowing_drive_fraction * largest_N)
        against = mark_slowing_before_driving(slowing & whole & (drive_N > 0.0), against, driving)
        mass_kg = machine.machine.empty_mass_kg or largest_N / max(
            find_robust_maximum_force(acceleration[driving]), 1e-3
        )
        widths = np.array(
            [
                LIMITS.digging_mass_std_1 * mass_kg,
                LIMITS.digging_friction_std_1 * largest_N / max(fastest, 1e-3),
                LIMITS.digging_constant_std_1 * largest_N,
            ]
        )
        drives = driving | against
        # in a gap it is not known that the machine drives on
        stood = np.abs(speed) <= machine.settings.phases.standstill_speed_m_s
        stands = (stood | np.isnan(speed)) & ~drives
        ends = {way: np.flatnonzero(stands | (way * speed < 0.0)) for way in (-1, 0, 1)}
        goes_on, stands_so_far = np.flatnonzero(drives), np.cumsum(stands, dtype=np.int64)
        for start in split_driving_at_pauses_and_turns(drives, speed, machine.settings):
            rows = select_longest_part_without_stop(start, stands_so_far)
            way = int(np.sign(np.mean(speed[rows])))
            grown_N, std_N = estimate_resistance_growth_and_std(
                np.column_stack([way * acceleration[rows], way * speed[rows]]),
                way * force[rows],
                (t_ns[rows] - t_ns[rows[0]]) / max(t_ns[rows[-1]] - t_ns[rows[0]], 1),
                LIMITS.digging_mass_ratio * mass_kg,
                widths,
                LIMITS.digging_misfit_fraction * largest_N,
            )
            least_N = max(
                LIMITS.pile_min_growth_fraction * largest_N, LIMITS.pile_min_growth_std * std_N
            )
            if least_N < abs(grown_N) < LIMITS.pile_max_growth_fraction * largest_N:
                row = int(t_ns[start[0]]), int(t_ns[start[-1]]), grown_N, std_N
                stops = find_next_row_or_infinity(
                    ends[way], int(start[-1])
                ) <= find_next_row_or_infinity(goes_on, int(start[-1]))
                stops &= float(np.abs(speed[rows]).max()) <= LIMITS.pile_max_speed_m_s
                found.append(_PileContact(row, way, stops))
    return found


def select_pile_contacts(candidates: list[_PileContact]) -> list[_PileContact]:
    """Select starts driven into a pile; none if resistance also varies without piles."""
    grows = [each for each in candidates if each.row[2] > 0.0]
    # most starts go towards the bucket: the signs of a log may be reversed
    bucket = 1 if 2 * sum(each.way > 0 for each in grows) >= len(grows) else -1
    piles = [each for each in grows if each.way == bucket and each.stops]
    # as the machine backs out of a pile, the resistance of the bucket falls
    let_go = sum(each.way != bucket and each.row[2] < 0.0 for each in candidates)
    against = len(candidates) - len(piles) - let_go
    return piles if against < LIMITS.pile_contradiction_fraction * len(piles) else []


def find_next_row_or_infinity(rows: Ints, after_row: int) -> float:
    """First of the ascending `rows` that is greater than `after_row`; infinite if none is."""
    place = int(np.searchsorted(rows, after_row, "right"))
    return float(rows[place]) if place < rows.size else np.inf


def reject_windows_with_digging(
    gated: pl.DataFrame, excitation: pl.DataFrame, digging: pl.DataFrame, machine: Machine
) -> pl.DataFrame:
    """The gate, with windows that contain a digging sample rejected.

    Args:
        gated: frame with the accepted windows.
        excitation: frame with the phases.
        digging: the frame `digging`.
        machine: machine file with settings.
    """
    if digging.is_empty():
        return gated
    # the phase sees a start late, and its end
    dug = mark_digging_samples(
        excitation["t_ns"].to_numpy(),
        digging,
        count_rows_in_speed_rate_span(machine.settings),
    )
    return reject_windows_with_excluded_rows(gated, dug, "digging", machine.settings)


def add_column_of_digging_starts(aligned: pl.DataFrame, digging: pl.DataFrame) -> pl.DataFrame:
    """`aligned` with a column `digs`: True where a sample lies in a digging start."""
    return aligned.with_columns(
        digs=pl.Series(mark_digging_samples(aligned["t_ns"].to_numpy(), digging))
    )


def mark_digging_samples(t_ns: Ints, digging: pl.DataFrame, margin: int = 0) -> Bools:
    """Flags of the samples within a digging start, or at most `margin` samples from one, (n,)."""
    dug = np.zeros(t_ns.size, np.bool_)
    for start, end in digging.select("start_t_ns", "end_t_ns").iter_rows():
        first, last = np.searchsorted(t_ns, [start, end])
        dug[max(first - margin, 0) : last + margin + 1] = True
    return dug


def find_robust_maximum_force(force: Floats) -> float:
    """Quantile `LIMITS.reached_quantile` of the magnitudes: a maximum that outliers do not set."""
    return float(np.quantile(np.abs(force), LIMITS.reached_quantile))


def split_driving_at_pauses_and_turns(
    is_driving: Bools, speed: Floats, settings: Settings
) -> list[Ints]:
    """Row numbers of each stretch of driving one way that lasts no longer than a start may.

    Short pauses do not end a stretch; stretches too short for a start are left out.
    """
    rows = np.flatnonzero(is_driving)
    hole = max(1, round(LIMITS.start_pause_s * settings.align.rate_hz))
    turns = np.diff(np.sign(speed[rows])) != 0
    parts = np.split(rows, np.flatnonzero((np.diff(rows) > hole) | turns) + 1)
    longest = round(LIMITS.start_max_s * settings.align.rate_hz)
    fewest = max(LIMITS.start_min_samples, round(LIMITS.start_min_s * settings.align.rate_hz))
    return [part for part in parts if fewest <= part.size <= longest]


def mark_slowing_before_driving(
    is_pushing: Bools, is_pushing_hard: Bools, is_driving: Bools
) -> Bools:
    """Mark samples that slow down under a large force, or on the way to it or to driving, (n,).

    A machine that meets a pile at a held speed slows down before its force has risen.

    Args:
        is_pushing: (n,) whether the machine slows down although its force drives.
        is_pushing_hard: (n,) the same under a large force.
        is_driving: (n,) whether the machine drives.
    """
    marked = is_pushing_hard.copy()
    until = np.append(is_pushing_hard | is_driving, False)
    for start, end in zip(*find_flagged_runs(is_pushing), strict=True):
        last = start + np.flatnonzero(until[start : end + 2])
        marked[start : last[-1] if last.size else start] = True
    return marked


def select_longest_part_without_stop(rows: Ints, stands_so_far: Ints) -> Ints:
    """Select a stretch's longest part without a stop: after one in a pile, lifting lurches.

    A stretch whose parts are too short for a start stays whole.

    Args:
        rows: row numbers of the stretch.
        stands_so_far: (n,) number of samples up to each row at which the machine stands.
    """
    stops = np.flatnonzero(np.diff(stands_so_far[rows]) > 0) + 1
    longest = max(np.split(rows, stops), key=len)
    return longest if longest.size >= LIMITS.start_min_samples else rows


def estimate_resistance_growth_and_std(
    motion: Floats,
    force: Floats,
    progress_1: Floats,
    mean_kg: float,
    prior_stds: Floats,
    noise_N: float,
) -> tuple[float, float]:
    """Growth of the resistance over a start, and its standard deviation, in N.

    The growth may begin at several points of the start; the most likely of them is used. A
    resistance that falls is estimated without friction if that were negative.

    Args:
        motion: (samples, 2) acceleration and speed.
        force: (samples,) force.
        progress_1: (samples,) from 0 at the beginning of the start to 1 at its end.
        mean_kg: prior mean of the mass.
        prior_stds: (3,) prior standard deviations of mass, viscous friction and constant.
        noise_N: standard deviation of the force residual.
    """
    weight = 1.0 / (noise_N**2 * LIMITS.digging_misfit_samples)
    growth, variance, friction = 0.0, np.inf, 0.0
    # a pile that slows the machine down is no friction that falls with the speed
    for friction_ratio in (1.0, LIMITS.no_friction_ratio):
        known = np.append((prior_stds * [1.0, friction_ratio, 1.0]) ** -2.0, 0.0)
        likeliest = -np.inf
        for met in LIMITS.pile_contact_fractions:
            ramp = np.maximum(progress_1 - met, 0.0) / (1.0 - met)
            design = np.column_stack([motion, np.ones(force.size), ramp])
            information = weight * design.T @ design + np.diag(known)
            right = weight * design.T @ force + known * np.array([mean_kg, 0.0, 0.0, 0.0])
            covariance = np.linalg.inv(information)
            # the reduction of the sum of squared residuals by this ramp, up to a constant
            taken = float(right @ covariance @ right)
            if taken > likeliest:
                likeliest, variance = taken, float(covariance[3, 3])
                friction, growth = (float(row @ right) for row in covariance[[1, 3]])
        if not growth < 0.0 > friction:
            break
    return growth, float(np.sqrt(variance))
