"""Reports while driving: the last mass with its uncertainty, age and validity.

A number is given only with its validity; it is null unless it is valid or merely old.
"""

import math
from dataclasses import dataclass, fields
from types import NoneType
from typing import Any, Final, Literal, TypeAlias, get_args, get_origin

from analysis.model.machine_body import Body
from analysis.online.online_limits import LIMITS
from estimators.estimate import Estimate

#: none_yet: no manoeuvre has given a mass; uncertain, implausible: the last mass is too uncertain
#: or implausible; old: it was valid, but longer ago than `valid_s`, so the load may have changed.
Validity: TypeAlias = Literal["valid", "old", "none_yet", "uncertain", "implausible"]
Event: TypeAlias = Literal["second", "manoeuvre", "spin", "end"]

_JSON_TYPES: Final = {
    float: "number",
    int: "integer",
    str: "string",
    bool: "boolean",
    NoneType: "null",
}


@dataclass(frozen=True, slots=True)
class PooledEstimate:
    """Pooled estimate of the last manoeuvre that gave one.

    Attributes:
        t_ns: time of the last pooled sample.
        estimate: mass in kg and friction in N·s/m, or inertia in kg·m² and friction of turning in
            N·m·s, with their random standard uncertainties.
    """

    t_ns: int
    estimate: Estimate


@dataclass(frozen=True, slots=True)
class OnlineReport:
    """A report: at the end of a manoeuvre or a spin, once a second of the log, and at its end.

    Attributes:
        event: event that the report is made for.
        unix_ns: Unix time of the report, in the time of the log.
        t_s: time since the first row.
        phase: phase of motion; None if unknown.
        gate: reason of the decision on the window that ends here.
        index_nat: index (11) of the window; None if it has none.
        validity: validity of mass and friction.
        mass_kg: mass by the last manoeuvre; None unless valid or old.
        mass_u_kg: random standard uncertainty of the mass, without errors that manoeuvres share.
        friction_x_N_s_m: viscous friction; None if unknown.
        friction_u_N_s_m: random standard uncertainty of the friction.
        age_s: time since the last sample that the mass is estimated from; None without a mass.
        manoeuvres: number of manoeuvres that have given a mass so far.
        load_mass_kg: mean mass of the manoeuvres with the present load; None before the first.
        load_u_kg: random standard uncertainty of `load_mass_kg`; None if unknown.
        load_manoeuvres: number of manoeuvres with the present load.
        until_u_kg: target uncertainty; None if none is stated.
        percent: information so far, in percent of that needed for the target; None without one.
        starts_missing: number of such manoeuvres still needed; None before the first.
        reverse_missing: number of those that should be in reverse.
        spin_validity: validity of inertia and friction of turning; `none_yet` without a yaw axis.
        inertia_z_kg_m2: inertia about the centre of the last spin; None unless valid or old.
        inertia_u_kg_m2: random standard uncertainty of the inertia.
        friction_z_N_m_s: viscous friction of turning; None if unknown.
        friction_z_u_N_m_s: random standard uncertainty of the friction of turning.
        spin_age_s: time since the last sample that the inertia is estimated from; None without one.
        spins: number of spins that have given an inertia so far.
    """

    event: Event
    unix_ns: int
    t_s: float
    phase: str | None
    gate: str
    index_nat: float | None
    validity: Validity
    mass_kg: float | None
    mass_u_kg: float | None
    friction_x_N_s_m: float | None
    friction_u_N_s_m: float | None
    age_s: float | None
    manoeuvres: int
    load_mass_kg: float | None = None
    load_u_kg: float | None = None
    load_manoeuvres: int = 0
    until_u_kg: float | None = None
    percent: float | None = None
    starts_missing: int | None = None
    reverse_missing: int | None = None
    spin_validity: Validity = "none_yet"
    inertia_z_kg_m2: float | None = None
    inertia_u_kg_m2: float | None = None
    friction_z_N_m_s: float | None = None
    friction_z_u_N_m_s: float | None = None
    spin_age_s: float | None = None
    spins: int = 0

    def to_dict(self) -> dict[str, Any]:
        """The fields by name, as JSON-compatible values."""
        return {name: getattr(self, name) for name in self.__slots__}


def make_report_schema() -> dict[str, Any]:
    """JSON schema of a report."""
    return {
        "title": "payscope.OnlineReport",
        "type": "object",
        "properties": describe_report_fields(OnlineReport),
        "required": [each.name for each in fields(OnlineReport)],
    }


def describe_report_fields(report: type[Any]) -> dict[str, dict[str, Any]]:
    """JSON type of each field: an enumeration, or a number or text that may be null."""
    return {each.name: _describe_json_type(each.type) for each in fields(report)}


def _describe_json_type(annotation: Any) -> dict[str, Any]:
    choices = get_args(annotation)
    if get_origin(annotation) is Literal:
        return {"type": "string", "enum": list(choices)}
    kinds = [_JSON_TYPES.get(each, "array") for each in choices or (annotation,)]
    return {"type": kinds if len(kinds) > 1 else kinds[0]}


def judge_mass_validity(
    last_estimate: PooledEstimate | None, t_ns: int, body: Body, valid_s: float
) -> Validity:
    """Validity of the last mass at a grid time `t_ns`.

    Args:
        last_estimate: last estimate; None before the first.
        t_ns: present grid time.
        body: machine body with its empty mass, if known.
        valid_s: age from which a mass is old.
    """
    empty = body.empty_mass_kg
    limits = (0.0, math.inf)
    if empty is not None:
        limits = (LIMITS.min_over_empty_1 * empty, LIMITS.max_over_empty_1 * empty)
    return _judge_validity_by_age(last_estimate, t_ns, valid_s, limits)


def judge_spin_validity(
    last_estimate: PooledEstimate | None, t_ns: int, valid_s: float
) -> Validity:
    """Validity of the last inertia at a grid time: it must be certain, positive and recent."""
    return _judge_validity_by_age(last_estimate, t_ns, valid_s, (0.0, math.inf))


def _judge_validity_by_age(
    last_estimate: PooledEstimate | None, t_ns: int, valid_s: float, limits: tuple[float, float]
) -> Validity:
    """Validity of the last estimate by its uncertainty, its limits and its age."""
    if last_estimate is None:
        return "none_yet"
    value, u = float(last_estimate.estimate.theta[0]), float(last_estimate.estimate.std[0])
    if not (math.isfinite(value) and math.isfinite(u)) or u > LIMITS.certain_mass_u_1 * abs(value):
        return "uncertain"
    least, most = limits
    if value <= 0.0 or not least <= value <= most:
        return "implausible"
    return "valid" if t_ns - last_estimate.t_ns <= valid_s * 1e9 else "old"
