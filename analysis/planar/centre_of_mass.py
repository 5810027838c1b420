"""The centre of mass from arcs (stage 3), and all parameters that planar motion determines.

On an arc v and ω are constant, so the index (11) is undefined: an arc is accepted if it lasts a
window and the predicted deviation of the centre of mass is small. One arc alone determines nothing;
mass, inertia and friction come from straight motion and spins of the same log. Further forces of a
real machine (`terms`) are fitted with priors; errors that no log shows are in the uncertainty.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.model.axes import Axis, X, Z
from analysis.model.machine import Machine
from analysis.model.schema import FRAMES, build_frame
from analysis.model.settings import Settings
from analysis.model.uncertainty_sources import IMU_POSITION
from analysis.model.verdict import Check, Verdict
from analysis.planar.planar_budget import (
    compute_combined_uncertainty,
    compute_quantity_gradient,
    join_missing_setting_names,
    make_planar_budget_rows,
)
from analysis.planar.planar_limits import LIMITS
from analysis.planar.planar_motion import has_lateral_accelerometer, make_planar_drive
from analysis.planar.planar_regressor import Regressor, select_terms_of_drive
from analysis.planar.planar_samples import (
    PlanarSamples,
    collect_planar_samples,
    compute_planar_column_noise,
    mark_turn_transitions,
)
from analysis.planar.planar_terms import TERMS
from analysis.stages.estimation import fit_quality
from analysis.stages.gating.gate import mark_samples_for_pooling
from analysis.stages.gating.segments import assign_manoeuvre_numbers_to_samples
from estimators.arrays import Bools, Floats, Ints
from estimators.planar import base_parameters
from estimators.planar.base_estimate import BaseEstimate, Prior
from estimators.planar.planar_rows import MOMENTS, PARAMETERS

#: Columns of value and deviation of every parameter.
_COLUMNS: Final = {
    **dict((*X.parameters, *Z.parameters)),
    **{name: name.replace("_kg_m", "_std_kg_m") for name in MOMENTS},
}
_COM: Final = ("com_x_m", "com_x_std_m", "com_y_m", "com_y_std_m")
_UNKNOWN: Final = ("scale_unknown", "com_scale_unknown")
#: Rows of the regressor that straight motion, spins and all motion are fitted with.
_FORCE, _TORQUE, _BOTH = slice(0, 1), slice(1, 2), slice(0, 2)
_ALL: Final = tuple(range(len(PARAMETERS)))
_STAGES: Final = ((X, _FORCE, (0, 4)), (Z, _TORQUE, (1, 5)))


@dataclass(frozen=True, slots=True)
class PlanarLog:
    """Inputs of every fit of a log."""

    plane: PlanarSamples
    excitation: pl.DataFrame
    machine: Machine


@dataclass(frozen=True, slots=True)
class PlanarFit:
    """A fit, and the name of each row of its `responses`; a term may have two rows."""

    estimate: BaseEstimate
    response_names: tuple[str, ...]


def make_planar_frames(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    verdict: Verdict,
    machine: Machine,
    noise: pl.DataFrame | None = None,
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Make `planar`: a row per arc, one for all arcs together, and one for all motion together.

    Args:
        excitation: motion, forces and phases.
        gated: frame `gate`; its accepted windows select straight motion and spins.
        verdict: verdict of the log; quantities that it withholds are neither used nor reported.
        machine: machine file with the known body, exclusions, limits and priors.
        noise: noise of the columns, if known.

    Returns:
        `planar`, without rows if the machine does not turn. Parameters that the motion does not
        determine are null, and `combinations` states the combinations that it determines instead.
        And `planar_budget`, the uncertainty budget of the fit of all motion.
    """
    log = PlanarLog(
        collect_planar_samples(excitation, machine.settings, noise), excitation, machine
    )
    joint = fit_all_motion_and_make_row(log, verdict)
    start = joint[1].estimate.coefficients[: len(PARAMETERS)] if joint else np.zeros(6)
    start = start if np.isfinite(start).all() else np.zeros(6)
    rows = list(iter_fit_rows_of_arcs_and_all_arcs(log, gated, verdict, start))
    rows += [joint[0]] if joint else []
    declared = FRAMES["planar"].columns
    table = pl.DataFrame(rows, schema={c.name: c.dtype for c in declared}, orient="row")
    parts = (
        make_planar_budget_rows(joint[0], joint[1].estimate, joint[1].response_names, machine)
        if joint
        else []
    )
    declared = FRAMES["planar_budget"].columns
    budget = pl.DataFrame(parts, schema={c.name: c.dtype for c in declared}, orient="row")
    return build_frame("planar", table.to_dict()), build_frame("planar_budget", budget.to_dict())


def iter_fit_rows_of_arcs_and_all_arcs(
    log: PlanarLog, gated: pl.DataFrame, verdict: Verdict, initial_parameters: Floats
) -> Iterator[dict[str, Any]]:
    """Yield the row of each arc that lasts a window, and that of the fit of all arcs."""
    plane, settings = log.plane, log.machine.settings
    steady = plane.usable & (log.excitation["phase"] == "arc").fill_null(False).to_numpy()
    arc_id = np.where(steady, assign_manoeuvre_numbers_to_samples(log.excitation, settings), -1)
    ids, starts, counts = np.unique(arc_id[steady], return_index=True, return_counts=True)
    lasting = counts >= settings.gate.window_samples
    if not lasting.any():
        return
    # an arc is one stretch of the log
    rows = np.flatnonzero(steady)
    firsts, lasts = rows[starts[lasting]], rows[(starts + counts - 1)[lasting]]
    known = Prior.make_zero_mean({}, 2)
    for stage, used in zip(_STAGES, (verdict.can_weigh, verdict.can_estimate_inertia), strict=True):
        if used:
            known = known.combine_with_prior(
                make_arc_prior_from_axis(log, gated, initial_parameters, *stage)
            )
    # the yaw torque is used only if spins have confirmed it
    both = "friction_z_N_m_s" in known.names
    parts = [("arc", slice(first, last + 1)) for first, last in zip(firsts, lasts, strict=True)]
    parts += [("arcs", slice(firsts[0], lasts[-1] + 1))] if firsts.size > 1 else []
    lasting_ids = ids[lasting]
    for kind, part in parts:
        of = np.full(arc_id.size, -1)
        of[part] = np.where(np.isin(arc_id[part], lasting_ids), arc_id[part], -1)
        fitted = fit_parameters_iteratively(
            log, of, initial_parameters, known, _BOTH if both else _FORCE
        )
        row = _make_fit_row(kind, log, of >= 0, fitted, known.names)
        reason = "accepted"
        if not np.isfinite(row["com_x_m"]):
            reason = "ill_conditioned"
        elif not row["predicted_std_com_m"] <= settings.planar.threshold_std_com_m:
            reason = "low_information"
        yield _make_outcome_row(row, reason, withheld=not verdict.can_weigh)


def make_arc_prior_from_axis(
    log: PlanarLog,
    gated: pl.DataFrame,
    initial_parameters: Floats,
    axis: Axis,
    axes: slice,
    columns: tuple[int, ...],
) -> Prior:
    """Prior for arcs from straight motion or spins, including the terms of that axis alone."""
    nothing = Prior.make_zero_mean({}, 2)
    if axis is Z and not log.plane.has_torque:
        return nothing
    used = mark_samples_for_pooling(log.excitation, gated, log.machine.settings, axis)
    used &= log.plane.known
    if not used.any():
        return nothing
    fitted = fit_parameters_iteratively(
        log, np.where(used, 0, -1), initial_parameters, nothing, axes, columns
    ).estimate
    if not np.isfinite(fitted.theta).all():
        return nothing
    own = [
        n
        for n, name in enumerate(fitted.parameters)
        if does_parameter_occur_on_one_axis(name, axis)
    ]
    mean = np.zeros((2, len(own)))
    mean[axes] = fitted.by_axis[:, own]
    names = tuple(fitted.parameters[n] for n in own)
    return Prior(names, mean, fitted.covariance[np.ix_(own, own)])


def does_parameter_occur_on_one_axis(parameter_name: str, axis: Axis) -> bool:
    """Whether a parameter or term occurs in the equation of one axis only."""
    return parameter_name in PARAMETERS or any(
        term.name == parameter_name and term.axes == axis.letter for term in TERMS
    )


def fit_all_motion_and_make_row(
    log: PlanarLog, verdict: Verdict
) -> tuple[dict[str, Any], PlanarFit] | None:
    """Fit over all motion; None without enough turning or without yaw torque."""
    plane, settings = log.plane, log.machine.settings
    used = plane.usable & plane.moving & ~mark_turn_transitions(plane, settings)
    if not plane.has_torque or (used & plane.turning).sum() < settings.gate.window_samples:
        return None
    of = np.where(used, 0, -1)
    start = base_parameters.fit(
        plane.motion, plane.f, PARAMETERS, of, noise=compute_planar_column_noise(plane, used)
    ).coefficients
    fitted = fit_parameters_iteratively(log, of, start, Prior.make_zero_mean({}, 2), _BOTH)
    row = _make_fit_row("joint", log, used, fitted, ())
    estimate = fitted.estimate
    variance = np.var(plane.f, axis=0, where=used[:, None])
    out = np.full(2, np.nan)  # of a constant force nothing is explained
    unexplained = np.divide(estimate.residual_rms**2, variance, out=out, where=variance > 0.0)
    row["r_squared_x_1"], row["r_squared_z_1"] = (1.0 - unexplained).tolist()
    believed = is_joint_planar_fit_plausible(plane, estimate, row, settings) and not any(
        does_check_concern_joint_motion(each, log.machine)
        for each in verdict.withholding_checks_beyond_limit
    )
    reason = "accepted" if estimate.identifiability.identifiable.any() else "ill_conditioned"
    return _make_outcome_row(row, reason, withheld=not believed), fitted


def does_check_concern_joint_motion(check: Check, machine: Machine) -> bool:
    """Whether a failed check also makes the fit of all motion wrong.

    That fit needs no windows. If the machine spins about another point than the origin, the first
    moments are not 0, and are fitted; an accelerometer at another position than stated has the same
    effect, so its position must be stated with an uncertainty, and be near the origin.
    """
    if check.check == "spin_centre_m":
        far_m = LIMITS.spin_centre_max_1 * (machine.machine.track_width_m or 0.0) / 2.0
        vouched = has_lateral_accelerometer(machine) and IMU_POSITION.u(machine) is not None
        return not vouched or (check.value or 0.0) > far_m
    return check.check != "accepted_stretches"


def is_joint_planar_fit_plausible(
    samples: PlanarSamples, estimate: BaseEstimate, fit_row: Mapping[str, Any], settings: Settings
) -> bool:
    """Whether the joint fit passes the checks of straight motion on its own ungated samples."""
    limits = settings.verdict
    explained = min(fit_row["r_squared_x_1"], fit_row["r_squared_z_1"])
    # mass and inertia, unless the motion does not determine them
    known = np.isfinite(estimate.theta[:2])
    theta, std = estimate.theta[:2][known], estimate.parameter_stds[:2][known]
    force, speeds_up = samples.f[:, 0], samples.known & (samples.speed_change_sign > 0)
    driving = fit_quality.compute_fraction_of_samples_with_force_along_motion(
        samples.motion.speed, force, speeds_up
    )
    along = np.column_stack([samples.motion.specific_force_x, samples.motion.speed])
    opposing = fit_quality.compute_fraction_of_braked_samples_with_opposing_force(
        along, force, samples.known & (samples.speed_change_sign < 0), speeds_up
    )
    return (
        explained >= limits.r_squared_min
        and bool((theta > 0.0).all() and (std <= limits.relative_std_max * theta).all())
        and not driving < limits.driving_share_min
        and not opposing < limits.opposing_share_min
    )


def fit_parameters_iteratively(
    log: PlanarLog,
    stretch_of_sample: Ints,
    initial_parameters: Floats,
    prior: Prior,
    axes: slice,
    columns: tuple[int, ...] = _ALL,
) -> PlanarFit:
    """Fit the samples of all stretches repeatedly, with the terms of the last fitted parameters.

    Args:
        log: rows of the whole log.
        stretch_of_sample: (n,) stretch of each sample, negative for none.
        initial_parameters: (6,) mass, inertia, moments and frictions for the first fit.
        prior: prior by the earlier stages, with its terms.
        axes: fitted axes: force, yaw torque, or both.
        columns: indices of the fitted parameters among the six.
    """
    fit = fit_parameters_once(log, stretch_of_sample, initial_parameters, prior, axes, columns)
    for _ in range(LIMITS.motion_fit_rounds - 1):
        coefficients = initial_parameters.copy()
        found = fit.estimate.coefficients[: len(columns)]
        if np.isfinite(found).all():
            coefficients[list(columns)] = found
        fit = fit_parameters_once(log, stretch_of_sample, coefficients, prior, axes, columns)
    return fit


def fit_parameters_once(
    log: PlanarLog,
    stretch_of_sample: Ints,
    coefficients: Floats,
    known_prior: Prior,
    axes: slice,
    columns: tuple[int, ...],
) -> PlanarFit:
    """Fit once, with the terms of a machine that has these coefficients (6,)."""
    where = np.flatnonzero(stretch_of_sample >= 0)
    part = slice(int(where[0]), int(where[-1]) + 1)
    of_columns = np.array(columns)
    drive = make_planar_drive(log.plane, log.excitation, log.machine, coefficients)
    # a term that is a share of a column not fitted would be determined by that column's noise
    terms = [
        (term, std)
        for term, std in select_terms_of_drive(drive, "xz"[axes])
        if term.list_combined_columns(drive, axes) <= set(columns)
    ]
    names = (*(PARAMETERS[n] for n in columns), *(term.name for term, _ in terms))
    width = {term.name: std for term, std in terms if term.name not in known_prior.names}
    regressor = Regressor.from_drive(
        drive.select_slice(part), of_columns, [term for term, _ in terms], axes
    )
    used, arm_y_m = stretch_of_sample >= 0, regressor.imu_position_m[1]
    noise = compute_planar_column_noise(log.plane, used, arm_y_m)[axes][:, of_columns]
    prior = known_prior.select_axes_and_parameters(axes, names).combine_with_prior(
        Prior.make_zero_mean(width, noise.shape[0])
    )
    fitted = base_parameters.fit(
        regressor,
        log.plane.f[part, axes],
        names,
        np.ascontiguousarray(stretch_of_sample[part]),
        prior,
        np.concatenate([noise, np.zeros((noise.shape[0], len(terms)))], axis=1),
        regressor.noise_mixing,
    )
    names = prior.names
    for term, _ in terms:
        if term.least_u and term.name in width:
            fitted = fitted.copy_with_parameter_uncertainty(term.name, term.least_u)
            names = (*names, term.name)
    return PlanarFit(fitted, names)


def _make_fit_row(
    motion_kind: str,
    log: PlanarLog,
    used_samples: Bools,
    fitted: PlanarFit,
    known_names: tuple[str, ...],
) -> dict[str, Any]:
    """Make the row of a fit, by column."""
    estimate, plane = fitted.estimate, log.plane
    found = estimate.identifiability
    t_ns = plane.t_ns[used_samples]
    row: dict[str, Any] = {
        "kind": motion_kind,
        "start_t_ns": int(t_ns[0]),
        "end_t_ns": int(t_ns[-1]),
        "samples": int(t_ns.size),
        "speed_x_m_s": float(plane.motion.speed[used_samples].mean()),
        "yaw_rate_rad_s": float(plane.motion.yaw_rate[used_samples].mean()),
        "condition_1": found.condition,
        "rank": found.rank,
        "identifiable": ", ".join(
            name
            for name, single in zip(found.parameters, found.identifiable, strict=True)
            if single
        ),
        "combinations": "; ".join(found.format_combinations()),
    }

    def compute_u(gradient: Floats) -> float:
        return compute_combined_uncertainty(estimate, gradient, fitted.response_names, log.machine)

    for name, value in zip(estimate.parameters, estimate.theta, strict=True):
        if name in PARAMETERS and name not in known_names:
            row[name], row[_COLUMNS[name]] = (
                float(value),
                compute_u(compute_quantity_gradient(estimate, name)),
            )
    for axis, moment in zip("xy", MOMENTS, strict=True):
        value, gradient = estimate.ratio_and_gradient(moment, "mass_kg")
        row[f"com_{axis}_m"], row[f"com_{axis}_std_m"] = value, compute_u(gradient)
    row["predicted_std_com_m"] = row["com_x_std_m"]
    scaled = {*MOMENTS, "inertia_z_kg_m2"} & {name for name in PARAMETERS if name in row}
    gradients = {
        "scale_unknown": [compute_quantity_gradient(estimate, name) for name in sorted(scaled)],
        "com_scale_unknown": [
            estimate.ratio_and_gradient(moment, "mass_kg")[1] for moment in MOMENTS
        ],
    }
    for column, wanted in gradients.items():
        row[column] = join_missing_setting_names(
            estimate, wanted, fitted.response_names, log.machine
        )
    names = ("residual_rms_N", "residual_rms_N_m")
    row |= dict(zip(names, estimate.residual_rms.tolist(), strict=False))
    return row


def _make_outcome_row(fit_row: dict[str, Any], reason: str, *, withheld: bool) -> dict[str, Any]:
    """The row with its reason, and without numbers if the fit is rejected or withheld."""
    fit_row = {**fit_row, "reason": reason, "withheld": withheld}
    if withheld or reason != "accepted":
        hidden = {*_COLUMNS, *_COLUMNS.values(), *_COM, *_UNKNOWN}
        fit_row = {name: None if name in hidden else value for name, value in fit_row.items()}
    return fit_row
