"""Terms of the joint fit for the energy of cycles, with their uncertainties."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final, TypeVar

import numpy as np
import polars as pl

from analysis.cycles.boom_dumps import mark_standing_samples
from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.energy_integrals import MotionErrors
from analysis.model.machine import Machine
from analysis.model.schema import get_column_values
from analysis.model.settings import PriorSettings
from analysis.model.windows import find_flagged_runs
from analysis.weighing.friction_warming import WARMING
from analysis.weighing.nuisances import compute_friction_prior_std_newtons
from estimators.arrays import Floats

#: Columns of `nuisances` with the name of a term, its value and its standard deviation.
_FOUND: Final = ("term", "posterior", "posterior_std")


@dataclass(frozen=True)
class ForceModel:
    """Force model of the joint fit, in the units of `nuisances`.

    Attributes:
        const: constant force.
        offset: part of the constant force that is a measurement error; the rest acts.
    """

    transfer: float
    gain_drift: float
    const: float
    offset: float
    viscous: float
    viscous_drift: float
    viscous_bend: float
    viscous_cubic: float
    direction: float
    quadratic: float

    @property
    def constant_force_without_offset_newtons(self) -> float:
        """Constant force that acts, such as a slope or an accelerometer tilt, in N."""
        return self.const - self.offset


Terms = TypeVar("Terms", ForceModel, MotionErrors)


def read_force_model_and_u(
    frames: Mapping[str, pl.DataFrame], mass_kg: Floats, priors: PriorSettings
) -> tuple[ForceModel, ForceModel]:
    """Force model of the fit, and its standard uncertainties.

    A constant force is partly a measurement error and partly a force that acts, split by the priors
    as in the fit, and by the readings at standstill.

    Args:
        frames: frames of the run.
        mass_kg: (n,) mass of machine and load.
        priors: priors of the fit.
    """
    rows = frames["nuisances"].select("term", "posterior", "posterior_std", "prior_std")
    term = {name: (value, std, prior) for name, value, std, prior in rows.iter_rows()}

    def read_term_value_and_std(name: str) -> tuple[float, float]:
        value, std, _ = term.get(name, (0.0, 0.0, 0.0))
        return value, std

    const, const_u = read_term_value_and_std("const")
    offset, offset_u = read_term_value_and_std("offset")
    both = term["const"][2] if "const" in term else 0.0
    excitation = frames["excitation"]
    wrong_N = priors.const_share * compute_high_quantile_of_driving_force_newtons(excitation)
    wrong_1 = min((wrong_N / both) ** 2, 1.0) if both else 0.0
    friction = ("friction_x_N_s_m", "friction_x_std_N_s_m")
    viscous: tuple[float, float] = frames["loads"].select(friction).drop_nulls().row(0)
    # none of these terms grows with the load, so that such forces are an uncertainty
    loaded_1 = float(np.quantile(mass_kg, 0.9) / np.quantile(mass_kg, 0.1)) - 1.0
    const_u, direction_u, viscous_u = (
        float(np.hypot(std, loaded_1 * np.hypot(*read_term_value_and_std(f"weight_{name}"))))
        for name, std in (
            ("const", const_u),
            ("direction", read_term_value_and_std("direction")[1]),
            ("viscous", viscous[1]),
        )
    )
    pairs = {
        "transfer": read_term_value_and_std("load_transfer"),
        "gain_drift": read_term_value_and_std("gain_drift"),
        "const": (const, const_u),
        "offset": combine_fitted_and_standstill_force_offset(
            (wrong_1 * const + offset, offset_u), excitation, mass_kg
        ),
        "viscous": (viscous[0], viscous_u),
        **{name: read_term_value_and_std(name) for name in WARMING},
        "direction": (read_term_value_and_std("direction")[0], direction_u),
        "quadratic": read_term_value_and_std("quadratic"),
    }
    value = ForceModel(**{name: pair[0] for name, pair in pairs.items()})
    return value, ForceModel(**{name: pair[1] for name, pair in pairs.items()})


def estimate_unfitted_coulomb_std_newtons(
    frames: Mapping[str, pl.DataFrame], mass_kg: Floats, machine: Machine
) -> float:
    """Standard deviation of Coulomb friction if the fit has no such term, in N.

    With all driving in one direction, Coulomb friction is part of viscous friction and constant.

    Returns:
        0 if the fit has the term.
    """
    if "direction" in frames["nuisances"]["term"]:
        return 0.0
    weight_N = float(np.quantile(mass_kg, 0.1)) * machine.machine.gravity_m_s2
    priors = machine.settings.priors
    return compute_friction_prior_std_newtons(
        compute_high_quantile_of_driving_force_newtons(frames["excitation"]), weight_N, priors
    )


def compute_high_quantile_of_driving_force_newtons(excitation: pl.DataFrame) -> float:
    """95 % quantile of the force of the log, in N."""
    driving = excitation.filter(pl.col("phase").is_in(["accelerating", "cruising"]))
    pushed_N = np.abs(get_column_values(driving, "force_x_N"))
    return float(np.nanquantile(pushed_N, 0.95)) if pushed_N.size else 0.0


def combine_fitted_and_standstill_force_offset(
    fitted_offset_and_u: tuple[float, float], excitation: pl.DataFrame, mass_kg: Floats
) -> tuple[float, float]:
    """Combine the force offsets of the fit and of the standstills, in N, with the uncertainty.

    If they contradict each other, the fit's offset is used.
    """
    at_rest = estimate_standstill_force_offset_and_u(excitation, mass_kg)
    if at_rest is None or not fitted_offset_and_u[1]:
        return fitted_offset_and_u
    (fit_N, fit_u), (rest_N, rest_u) = fitted_offset_and_u, at_rest
    if abs(fit_N - rest_N) > LIMITS.offset_contradiction_u * np.hypot(fit_u, rest_u):
        return fitted_offset_and_u
    weights = np.array([fit_u, rest_u]) ** -2.0
    return float(np.average([fit_N, rest_N], weights=weights)), float(weights.sum() ** -0.5)


def estimate_standstill_force_offset_and_u(
    excitation: pl.DataFrame, mass_kg: Floats
) -> tuple[float, float] | None:
    """Force measured at standstill on level ground, in N, and its uncertainty.

    On a slope brakes or motor hold the machine: the median force of each standstill is regressed on
    the weight along the slope, and the offset is the intercept. Static friction varies between
    standstills, and is part of the uncertainty.

    Returns:
        The offset and its uncertainty; None if there are too few standstills.
    """
    force, acceleration = (
        get_column_values(excitation, name) for name in ("force_x_N", "regressor_acc_x_m_s2")
    )
    means: list[tuple[float, float]] = []
    for begin, end in zip(*find_flagged_runs(mark_standing_samples(excitation)), strict=True):
        # without the ends of a standstill, where the motor force still falls or already rises
        quarter = (end - begin) // 4
        quiet = slice(begin + quarter, end - quarter + 1)
        weight_N = mass_kg[quiet] * acceleration[quiet]
        pair = (float(np.median(force[quiet])), float(np.median(weight_N)))
        if np.isfinite(pair).all():
            means.append(pair)
    if len(means) < LIMITS.force_offset_min_stands:
        return None
    y, weight = np.array(means).T
    # in kN, so that both columns have a similar size
    A = np.column_stack([np.ones(y.size), weight / 1e3])
    found, *_ = np.linalg.lstsq(A, y)
    left = y - A @ found
    variance = float(left @ left) / (y.size - 2)
    u_N = float(np.sqrt(variance * np.linalg.pinv(A.T @ A)[0, 0]))
    return (float(found[0]), u_N) if u_N > 0.0 else None


def read_motion_errors_and_u(
    nuisances: pl.DataFrame, model: ForceModel, machine: Machine
) -> tuple[MotionErrors, MotionErrors]:
    """Delays and slip by the fit, and their standard uncertainties.

    Slip is that estimated from the wheels if known, otherwise derived from its share of friction.
    """
    term = {name: (value, std) for name, value, std in nuisances.select(_FOUND).iter_rows()}
    nothing = (0.0, 0.0)
    by_friction = tuple(x / max(model.viscous, 1e-9) for x in term.get("slip", nothing))
    slip = term.get("wheel_slip", (-by_friction[0], by_friction[1]) if model.viscous else nothing)
    by_accelerometer = machine.settings.forces.acceleration == "specific_force"
    delay = term.get("speed_delay", nothing) if by_accelerometer else nothing
    pairs = (term.get("lag", nothing), delay, slip)
    return MotionErrors(*(v for v, _ in pairs)), MotionErrors(*(u for _, u in pairs))


def perturb_terms_one_by_one(term_values: Terms, stds: Terms) -> list[Terms]:
    """Copies of the values, each with one term changed by its standard uncertainty."""
    names = [each.name for each in fields(term_values) if getattr(stds, each.name)]
    return [
        replace(term_values, **{name: getattr(term_values, name) + getattr(stds, name)})
        for name in names
    ]


def combine_relative_work_u_and_missing_settings(machine: Machine) -> tuple[float, str]:
    """Relative standard uncertainty of the measured work, and the settings missing for it.

    The product of torque and speed of the same wheels does not depend on their radius.
    """
    body = machine.machine
    parts = {"force_gain_u": body.force_gain_u}
    if body.force_share < 1.0:
        share_u = body.force_share_u
        parts["force_share_u"] = None if share_u is None else share_u / body.force_share
    by_torque = "force_x_N" not in machine.channels
    of_wheels = [c for name, c in machine.channels.items() if name.startswith("speed_")]
    cancels = by_torque and any(c.scale == body.wheel_radius_m for c in of_wheels)
    if by_torque and not cancels:
        parts["wheel_radius_u_m"] = body.wheel_radius_u_1
    unknown = [f"machine.{name}" for name, u in parts.items() if u is None]
    return float(np.linalg.norm([u or 0.0 for u in parts.values()])), ", ".join(unknown)


def compute_relative_common_and_individual_mass_u(
    frames: Mapping[str, pl.DataFrame],
) -> tuple[float, float]:
    """Relative standard uncertainty of masses on the force's scale: common, and individual."""
    loads = frames["loads"].filter(pl.col("mass_kg").is_not_null())
    budget = frames["budget"].filter(pl.col("kind") == "common").group_by("load_id")
    squares = budget.agg((pl.col("u_kg").fill_null(0.0) ** 2).sum().sqrt().alias("common_kg"))
    both = loads.join(squares, on="load_id", how="left")
    if both.is_empty():
        return 0.0, 0.0
    common, random = (
        both.select((pl.col(name) / pl.col("mass_kg")).median()).item()
        for name in ("common_kg", "u_random_kg")
    )
    return float(common or 0.0), float(random or 0.0)
