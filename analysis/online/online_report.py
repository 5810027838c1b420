"""What is told of a machine while it drives: the last mass, how sure, how old, and if it is valid.

A number is given only with its validity: what is not valid or merely old is null.
"""

import math
from dataclasses import dataclass, fields
from types import NoneType
from typing import Any, Final, Literal, TypeAlias, get_args, get_origin

from analysis.model.machine import Body
from estimators.estimate import Estimate

#: none_yet: no manoeuvre has given a mass; uncertain, implausible: the last one is not worth its
#: name; old: it is, but was measured longer ago than `valid_s`, and the load may have changed.
Validity: TypeAlias = Literal["valid", "old", "none_yet", "uncertain", "implausible"]
Event: TypeAlias = Literal["second", "manoeuvre", "end"]

#: A standard uncertainty above this share of the mass tells no load: a full bucket of a skid-steer
#: loader is a third of the machine.
LARGEST_U_1: Final = 0.1
#: A loaded machine weighs no less than this share of the empty one, and no more than that multiple.
LEAST_OF_EMPTY_1: Final = 0.5
MOST_OF_EMPTY_1: Final = 4.0
#: Seconds for which a mass counts as that of the machine now, unless the caller says otherwise.
VALID_S: Final = 120.0


_JSON_TYPES: Final = {float: "number", int: "integer", str: "string", NoneType: "null"}


@dataclass(frozen=True, slots=True)
class LastMass:
    """The pooled estimate of the last manoeuvre that gave one.

    Attributes:
        t_ns: of its last sample.
        estimate: mass in kg and friction in N·s/m, with their random standard uncertainties.
    """

    t_ns: int
    estimate: Estimate


@dataclass(frozen=True, slots=True)
class OnlineReport:
    """A report: at the end of a manoeuvre, once a second of the log, and at its end.

    Attributes:
        event: what it is made for.
        unix_ns: when, in the log's time.
        t_s: the same from the first row.
        phase: of motion; None where it is not known.
        gate: the reason of the window that ends here.
        index_nat: its index (11); None where it has none.
        validity: of mass and friction.
        mass_kg: of the last manoeuvre; None unless valid or old.
        mass_u_kg: random standard uncertainty: what all manoeuvres share is not in it.
        friction_x_N_s_m: viscous friction; None likewise.
        friction_u_N_s_m: random standard uncertainty.
        age_s: since the last sample that the mass is made of; None without one.
        manoeuvres: how many have given a mass so far.
        load_mass_kg: mean of the manoeuvres with the load of now; None before the first.
        load_u_kg: its random standard uncertainty; None likewise.
        load_manoeuvres: how many they are.
        until_u_kg: the uncertainty that is aimed at; None where nothing says which.
        percent: of the information that takes; None likewise.
        starts_missing: manoeuvres like these until then; None before the first.
        reverse_missing: those of them that should be driven backwards.
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

    def to_dict(self) -> dict[str, Any]:
        """The fields by name, as JSON has them."""
        return {name: getattr(self, name) for name in self.__slots__}


def report_schema() -> dict[str, Any]:
    """The JSON schema of a report."""
    return {
        "title": "payscope.OnlineReport",
        "type": "object",
        "properties": {each.name: _json_type(each.type) for each in fields(OnlineReport)},
        "required": [each.name for each in fields(OnlineReport)],
    }


def _json_type(annotation: Any) -> dict[str, Any]:
    """The JSON type of a field: a word among some, or a number or text that may be null."""
    choices = get_args(annotation)
    if get_origin(annotation) is Literal:
        return {"type": "string", "enum": list(choices)}
    kinds = [_JSON_TYPES[each] for each in choices or (annotation,)]
    return {"type": kinds if len(kinds) > 1 else kinds[0]}


def judge(last: LastMass | None, t_ns: int, body: Body, valid_s: float) -> Validity:
    """Judge the last mass at a time `t_ns` of the grid.

    Args:
        last: None before the first.
        t_ns: now.
        body: with its empty mass, where that is known.
        valid_s: an older mass is old.
    """
    if last is None:
        return "none_yet"
    mass, u = float(last.estimate.theta[0]), float(last.estimate.std[0])
    if not (math.isfinite(mass) and math.isfinite(u)) or u > LARGEST_U_1 * abs(mass):
        return "uncertain"
    empty = body.empty_mass_kg
    if mass <= 0.0 or (
        empty is not None and not LEAST_OF_EMPTY_1 * empty <= mass <= MOST_OF_EMPTY_1 * empty
    ):
        return "implausible"
    return "valid" if t_ns - last.t_ns <= valid_s * 1e9 else "old"
