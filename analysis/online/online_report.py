"""Reports while driving: the last mass with its uncertainty, age and validity.

A number is given only with its validity: what is not valid or merely old is null.
"""

import math
from dataclasses import dataclass, fields
from types import NoneType
from typing import Any, Final, Literal, TypeAlias, get_args, get_origin

from analysis.model.machine_body import Body
from analysis.online.online_limits import LIMITS
from estimators.estimate import Estimate

#: none_yet: no manoeuvre has given a mass; uncertain, implausible: the last one is not worth its
#: name; old: it is, but was measured longer ago than `valid_s`, and the load may have changed.
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
        t_ns: time of its last sample.
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
        unix_ns: when, in the log's time.
        t_s: the same from the first row.
        phase: phase of motion; None if unknown.
        gate: the reason of the window that ends here.
        index_nat: index (11) of the window; None if it has none.
        validity: of mass and friction.
        mass_kg: of the last manoeuvre; None unless valid or old.
        mass_u_kg: random standard uncertainty: what all manoeuvres share is not in it.
        friction_x_N_s_m: viscous friction; None if unknown.
        friction_u_N_s_m: random standard uncertainty.
        age_s: since the last sample that the mass is made of; None without one.
        manoeuvres: how many have given a mass so far.
        load_mass_kg: mean of the manoeuvres with the load of now; None before the first.
        load_u_kg: random standard uncertainty of the load; None if unknown.
        load_manoeuvres: how many they are.
        until_u_kg: target uncertainty; None if none is stated.
        percent: percentage of the information needed for that; None without a target.
        starts_missing: manoeuvres like these until then; None before the first.
        reverse_missing: those of them that should be driven backwards.
        spin_validity: of inertia and friction of turning; `none_yet` also without a yaw axis.
        inertia_z_kg_m2: about the point that the last spin turned about; None unless valid or old.
        inertia_u_kg_m2: random standard uncertainty.
        friction_z_N_m_s: viscous friction of turning; None if unknown.
        friction_z_u_N_m_s: random standard uncertainty.
        spin_age_s: since the last sample that they are made of; None without one.
        spins: how many have given an inertia so far.
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
        """The fields by name, as JSON has them."""
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
    """JSON type of each field: one of some words, or a number or text that may be null."""
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
        t_ns: present time.
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
    """Validity of the last inertia at a grid time; it only has to be positive and recent."""
    return _judge_validity_by_age(last_estimate, t_ns, valid_s, (0.0, math.inf))


def _judge_validity_by_age(
    last_estimate: PooledEstimate | None, t_ns: int, valid_s: float, limits: tuple[float, float]
) -> Validity:
    """Validity of the last estimate by its size, uncertainty and age."""
    if last_estimate is None:
        return "none_yet"
    value, u = float(last_estimate.estimate.theta[0]), float(last_estimate.estimate.std[0])
    if not (math.isfinite(value) and math.isfinite(u)) or u > LIMITS.certain_mass_u_1 * abs(value):
        return "uncertain"
    least, most = limits
    if value <= 0.0 or not least <= value <= most:
        return "implausible"
    return "valid" if t_ns - last_estimate.t_ns <= valid_s * 1e9 else "old"
