"""Relative positions of a bench's records, since the start position of each is unknown.

A force that depends on the position gives them: records of one path show the same force at the same
position. The offset of each record from the first is found by Gauss-Newton, with a mass for each
record. In the search of load states, the part of such a force that is weight is proportional to the
mass.
"""

from dataclasses import replace

import numpy as np

from analysis.weighing.fit_columns import FitRows
from analysis.weighing.force_by_position import (
    BY_PLACE,
    make_position_force_columns,
    make_position_force_slopes,
)
from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.weighing_limits import LIMITS


def align_paths_of_bench_records(motion: MotionSamples) -> MotionSamples:
    """Align the paths of a bench's records by their position-dependent force.

    Other logs, and those of a single record, are returned as they are.
    """
    used = motion.is_fittable
    if motion.long_gap_count is None or not used.any() or not motion.is_short_path_bench_log:
        return motion
    record = np.unique(motion.long_gap_count[used], return_inverse=True)[1]
    records = int(record.max()) + 1
    if records < 2:
        return motion
    of_record = np.eye(records)[record]
    straight = np.column_stack(
        (
            motion.acceleration[used, None] * of_record,
            motion.speed[used],
            motion.direction[used],
            np.ones(record.size),
        )
    )
    force, place_1 = motion.force[used], motion.path_position_1[used]
    off_1 = estimate_record_position_offsets(straight, force, place_1, of_record)
    number = np.searchsorted(np.unique(motion.long_gap_count[used]), motion.long_gap_count).clip(
        0, records - 1
    )
    place_1 = motion.path_position_1 + off_1[number]
    first, last = float(place_1[used].min()), float(place_1[used].max())
    length_1 = last - first
    return replace(
        motion,
        path_position_1=(place_1 - (first + last) / 2.0) / length_1,
        path_m=motion.path_m * length_1,
    )


def estimate_record_position_offsets(
    path_m: Floats, force: Floats, relative_position: Floats, record_of_sample: Floats
) -> Floats:
    """Offset of each record's position from the first one's, by the force at each position.

    Args:
        path_m: (n, columns) columns of the other forces: a mass per record, friction, a constant.
        force: (n,) force in N.
        relative_position: (n,) positions, with each record centred on its own path.
        record_of_sample: (n, records) 1 if the sample belongs to the record.

    Returns:
        (records,) offsets to add to the positions, as fractions of the path.
    """
    records = record_of_sample.shape[1]
    off_1 = np.zeros(records)
    best_1, least = off_1, np.inf
    for _ in range(LIMITS.place_rounds):
        place = relative_position + record_of_sample @ off_1
        known = np.column_stack((path_m, make_position_force_columns(place)))
        found, missed = _solve_ridge_regression(
            known, force, np.full(known.shape[1], LIMITS.free_column_std)
        )
        cost = float(missed @ missed) / max(float(force @ force), 1e-300)
        if cost >= least * (1.0 - 1e-9):
            break
        best_1, least = off_1, cost
        slope = make_position_force_slopes(place) @ found[path_m.shape[1] :]
        moving = np.column_stack((known, slope[:, None] * record_of_sample[:, 1:]))
        free = np.full(moving.shape[1], LIMITS.free_column_std)
        step = _solve_ridge_regression(moving, force, free)[0][known.shape[1] :]
        step = np.append(0.0, step).clip(-LIMITS.max_record_step_1, LIMITS.max_record_step_1)
        if float(np.abs(step).max()) < LIMITS.record_tolerance_1:
            break
        off_1 = (off_1 + step).clip(-LIMITS.max_record_offset_1, LIMITS.max_record_offset_1)
    return best_1


def make_load_search_rows(fit: JointFit, fit_rows: FitRows) -> tuple[FitRows, ...]:
    """Sets of rows for the load state search, with position-dependent weight added to the mass.

    A fit with one mass does not show how much of the position-dependent force is weight, so none
    and all of it are tried. After a fit with several masses, its estimate of that part is used.
    """
    motion, states = fit.motion, fit.states
    if not (motion.record_count > 1 and motion.is_short_path_bench_log and fit.mass_kg > 0.0):
        return (fit_rows,)
    theta = fit.theta[fit.mass_count + 1 :]
    place = [n for n, term in enumerate(fit.terms) if term.source == BY_PLACE and not term.by_load]
    if fit.mass_count == 1 or states is None:
        return fit_rows, add_gravity_by_position_to_mass_column(
            fit_rows, place, theta[place] / fit.mass_kg
        )
    grows = [n for n, term in enumerate(fit.terms) if term.source == BY_PLACE and term.by_load]
    usual_kg = float(np.mean(fit.masses_kg[states.state_of_manoeuvre]))
    taken = add_gravity_by_position_to_mass_column(fit_rows, place, theta[grows] / usual_kg)
    taken.A[:, 2 + np.array(grows)] = 0.0
    return (taken,)


def add_gravity_by_position_to_mass_column(
    fit_rows: FitRows, position_m: list[int], weight_m_s2: Floats
) -> FitRows:
    """Add the position-dependent weight per kg to the column that multiplies the mass.

    Args:
        fit_rows: rows of the fit; the mass has the first column.
        position_m: numbers of the position terms, whose columns follow the first two.
        weight_m_s2: (position terms,) weight per kg that each of these columns stands for.
    """
    A = fit_rows.A.copy()
    A[:, 0] += fit_rows.A[:, 2:][:, position_m] @ weight_m_s2
    return replace(fit_rows, A=A)


def _solve_ridge_regression(
    columns: Floats, force: Floats, prior_stds: Floats
) -> tuple[Floats, Floats]:
    """Solution and residual of a ridge regression.

    `prior_stds` are the prior standard deviations of the coefficients of scaled columns.
    """
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = columns / size
    normal = scaled.T @ scaled + np.diag(prior_stds**-2.0)
    found = np.linalg.solve(normal, scaled.T @ force)
    return found / size, force - scaled @ found
