"""Uncertainty budget of inertia, moments and centre of mass."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from analysis.model.machine import Machine
from analysis.model.uncertainty_sources import (
    IMU_POSITION,
    SCALES,
    TRACK_WIDTH,
    UncertaintySource,
    combine_u,
    has_side_torques,
    list_scale_sources_without_u,
    sort_sources_largest_first,
)
from analysis.planar.planar_limits import LIMITS
from analysis.planar.planar_terms import TERMS
from estimators.arrays import Floats
from estimators.planar.base_estimate import BaseEstimate
from estimators.planar.planar_rows import MOMENTS, PARAMETERS

_TERMS: Final = {term.name: term for term in TERMS}
#: Rows of the planar regressor.
_TORQUE: Final = 1
#: Quantities of the budget, with their units.
_QUANTITIES: Final = {
    "inertia_z_kg_m2": "kg·m²",
    "first_moment_x_kg_m": "kg·m",
    "first_moment_y_kg_m": "kg·m",
    "com_x_m": "m",
    "com_y_m": "m",
}


def compute_quantity_gradient(estimate: BaseEstimate, quantity: str) -> Floats:
    """Gradient (p,) of a parameter or quantity by the parameters."""
    return np.array([float(each == quantity) for each in estimate.parameters])


def list_uncertainty_sources_of_quantity(
    estimate: BaseEstimate, gradient: Floats, terms: tuple[str, ...], machine: Machine
) -> list[UncertaintySource]:
    """Uncertainty sources of a quantity, the largest first, unknown ones last.

    Args:
        estimate: the fit.
        gradient: (p,) derivatives of the quantity with respect to the parameters.
        terms: name of each row of its `responses`; rows that are not of a term count as noise.
        machine: machine file with its uncertainties.
    """
    at = np.flatnonzero(gradient)
    variance = float(gradient[at] @ estimate.covariance[np.ix_(at, at)] @ gradient[at])
    moved = estimate.responses[:, at] @ gradient[at]
    own: dict[str, float] = {}
    for name, u in zip(terms, moved, strict=True):
        if name in _TERMS:
            own[name] = float(np.hypot(own.get(name, 0.0), u))
    rest = np.sqrt(max(variance - sum(u**2 for u in own.values()), 0.0))
    found = [
        UncertaintySource(
            "noise", "random", float(rest), "noise of this log, through its residuals", "more turns"
        )
    ]
    stated: dict[str, float] = {}
    for name, u in own.items():
        term = _TERMS[name]
        if term.stated is None:
            found.append(UncertaintySource(name, "common", float(u), term.meaning, term.reduced_by))
        else:
            stated[term.stated.name] = float(np.hypot(stated.get(term.stated.name, 0.0), u))
    return sort_sources_largest_first(
        [*found, *iter_machine_uncertainty_sources(estimate, gradient, stated, machine)]
    )


def iter_machine_uncertainty_sources(
    estimate: BaseEstimate, gradient: Floats, fitted_values: dict[str, float], machine: Machine
) -> Iterator[UncertaintySource]:
    """Uncertainty sources that the machine file states or should state."""
    at = np.flatnonzero(gradient)
    shares = estimate.by_axis[:, at] @ gradient[at]
    whole = float(shares.sum())
    size = float(np.abs(estimate.by_axis[:, at] * gradient[at]).sum())
    torque = float(shares[_TORQUE]) if shares.size > _TORQUE else 0.0
    by_sides = shares.size > _TORQUE and has_side_torques(machine)
    body = machine.machine
    for scale in (*SCALES, TRACK_WIDTH):
        if not scale.applies(machine) or (scale is TRACK_WIDTH and not by_sides):
            continue
        change = torque if scale is TRACK_WIDTH else whole
        # each of two sides has its own gain
        sides = scale is SCALES[0] and by_sides
        if abs(change) <= LIMITS.cancelled_gain_1 * size and not sides:
            continue
        if scale.by_load:
            mass_kg = float(np.nan_to_num(estimate.coefficients[0])) - body.rotating_mass_kg
            empty_kg = body.empty_mass_kg or mass_kg
            change *= max(mass_kg / empty_kg - 1.0, 0.0) if empty_kg else 0.0
            if body.empty_mass_kg and abs(change) <= LIMITS.cancelled_load_gain_1 * size:
                continue
        u = scale.u(machine)
        part = fitted_values.get(scale.name, 0.0)
        yield scale.make_uncertainty_source(
            None if u is None else float(np.hypot(u * change, part))
        )
    if IMU_POSITION.applies(machine):
        known = IMU_POSITION.u(machine) is not None
        yield IMU_POSITION.make_uncertainty_source(
            fitted_values.get(IMU_POSITION.name, 0.0) if known else None
        )


def compute_combined_uncertainty(
    estimate: BaseEstimate, gradient: Floats, terms: tuple[str, ...], machine: Machine
) -> float:
    """Combined standard uncertainty of a quantity; NaN if the motion does not determine it."""
    at = np.flatnonzero(gradient)
    if not np.isfinite(estimate.covariance[np.ix_(at, at)]).all():
        return float("nan")
    return combine_u(list_uncertainty_sources_of_quantity(estimate, gradient, terms, machine))


def make_planar_budget_rows(
    fit_row: Mapping[str, Any], estimate: BaseEstimate, terms: tuple[str, ...], machine: Machine
) -> list[dict[str, Any]]:
    """Rows of `planar_budget` for each quantity that the fit of all motion determines.

    Args:
        fit_row: row of that fit in `planar`.
        estimate: the fit.
        terms: as in `list_uncertainty_sources_of_quantity`.
        machine: machine file with its uncertainties.
    """
    parts: list[dict[str, Any]] = []
    for quantity, unit in _QUANTITIES.items():
        if fit_row.get(quantity) is None or not np.isfinite(fit_row[quantity]):
            continue
        if quantity in PARAMETERS:
            gradient = compute_quantity_gradient(estimate, quantity)
        else:
            moment = MOMENTS["xy".index(quantity[4])]
            gradient = estimate.ratio_and_gradient(moment, "mass_kg")[1]
        found = list_uncertainty_sources_of_quantity(estimate, gradient, terms, machine)
        total = combine_u(found)
        parts += [
            {
                "quantity": quantity,
                "cause": source.name,
                "kind": source.kind,
                "u": source.u,
                "unit": unit,
                "share_1": None if source.u is None else (source.u / total) ** 2,
                "meaning": source.meaning,
                "shrinks": source.reduced_by,
            }
            for source in found
        ]
    return parts


def join_missing_setting_names(
    estimate: BaseEstimate, gradients: list[Floats], terms: tuple[str, ...], machine: Machine
) -> str:
    """Settings missing in the machine file that any of these quantities needs, with commas.

    Args:
        estimate: the fit.
        gradients: (p,) derivatives of each quantity with respect to the parameters.
        terms: as `list_uncertainty_sources_of_quantity` takes them.
        machine: machine file with its uncertainties.
    """
    names = (
        name
        for gradient in gradients
        if np.isfinite(gradient).all()
        for name in list_scale_sources_without_u(
            list_uncertainty_sources_of_quantity(estimate, gradient, terms, machine)
        )
    )
    return ", ".join(dict.fromkeys(names))
