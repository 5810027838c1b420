"""Reports of a replay in the background: load states so far, or the checks that withhold them.

A number is given only with its validity; it is null unless valid.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any, Final, Literal, Self, TypeAlias

from analysis.model.answer import Answer, make_answer
from analysis.model.run_record import Run
from analysis.online.online_report import describe_report_fields

#: valid: no check withholds the number; withheld: a check does; none_yet: the log so far is too
#: short for one; failed: the log could not be replayed.
ReplayValidity: TypeAlias = Literal["valid", "withheld", "none_yet", "failed"]
#: The fits in `planar` that give an inertia, the one with less uncertainty first.
_FITS_OF_TURNING: Final = ("joint", "arcs")


@dataclass(frozen=True, slots=True)
class LoadReport:
    """A load state.

    Attributes:
        load_id: number of the load state.
        start_unix_ns: start of its first manoeuvre.
        end_unix_ns: end of its last manoeuvre.
        manoeuvres: number of its manoeuvres in the joint fit.
        validity: validity of the numbers.
        withheld_by: checks that withhold the numbers; empty if valid.
        empty: whether the state counts as the empty machine.
        mass_kg: mass of machine and load; None unless valid.
        mass_u_kg: standard uncertainty of the mass, including errors that manoeuvres share.
        payload_kg: difference to the empty machine; None if unknown.
        payload_u_kg: standard uncertainty of the payload.
        friction_x_N_s_m: viscous friction, common to all loads.
        friction_u_N_s_m: standard uncertainty of the friction.
    """

    load_id: int
    start_unix_ns: int
    end_unix_ns: int
    manoeuvres: int
    validity: ReplayValidity
    withheld_by: str
    empty: bool
    mass_kg: float | None
    mass_u_kg: float | None
    payload_kg: float | None
    payload_u_kg: float | None
    friction_x_N_s_m: float | None
    friction_u_N_s_m: float | None


@dataclass(frozen=True, slots=True)
class ReplayReport:
    """Result of a replay of the log up to some time.

    Attributes:
        event: `replay`.
        unix_ns: time of the last replayed row.
        t_s: the same time in s since the first row.
        age_s: time in s by which the log had continued after that row when the result was ready.
        is_whole: whether this is the last replay, of everything recorded when following ended.
        validity: `valid` if any load is valid.
        withheld_by: checks that withhold the mass of every load.
        loads: load states in the order of their numbers.
        turning_validity: validity of the inertia; `none_yet` without arcs or joint motion.
        inertia_z_kg_m2: inertia by the fit of all motion, else of arcs; None unless valid.
        inertia_u_kg_m2: standard uncertainty of the inertia.
        processor_s: processor time that the replay took, in s.
        fingerprint: digest of the frames, as `payscope run` states it; empty without a result.
        fault: reason why there is no result; "" if there is one.
    """

    event: Literal["replay"]
    unix_ns: int
    t_s: float
    age_s: float
    is_whole: bool
    validity: ReplayValidity
    withheld_by: tuple[str, ...] = ()
    loads: tuple[LoadReport, ...] = ()
    turning_validity: ReplayValidity = "none_yet"
    inertia_z_kg_m2: float | None = None
    inertia_u_kg_m2: float | None = None
    processor_s: float = 0.0
    fingerprint: str = ""
    fault: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The fields by name, as JSON-compatible values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Build the report from its fields by name."""
        given = dict(values)
        loads = tuple(LoadReport(**load) for load in given.pop("loads"))
        return cls(loads=loads, withheld_by=tuple(given.pop("withheld_by")), **given)

    def copy_with_age_at(self, unix_ns: int) -> Self:
        """Copy of the report with its age at a later time of the log."""
        return replace(self, age_s=max(0.0, (unix_ns - self.unix_ns) / 1e9))

    @property
    def closed_loads(self) -> tuple[LoadReport, ...]:
        """Loads that are complete: all but the last, or all if the log is whole."""
        return self.loads if self.is_whole else self.loads[:-1]


def make_replay_report_schema() -> dict[str, Any]:
    """JSON schema of a report."""
    properties = describe_report_fields(ReplayReport)
    load = {"type": "object", "properties": describe_report_fields(LoadReport)}
    properties["loads"] = {"type": "array", "items": load}
    properties["withheld_by"] = {"type": "array", "items": {"type": "string"}}
    return {
        "title": "payscope.ReplayReport",
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }


def make_replay_report(run: Run) -> ReplayReport:
    """Report on a replay of the log so far, without the processor time that it took."""
    found, t_ns = make_answer(run), run.frames["excitation"]["t_ns"]
    t0_unix_ns, last_ns = run.provenance.t0_unix_ns, int(t_ns[-1]) if t_ns.len() else 0
    loads = tuple(iter_load_reports(found, t0_unix_ns))
    turning = select_fit_with_inertia(found.planar)
    inertia = replace_nonfinite_by_none(turning["inertia_z_kg_m2"]) if turning else None
    return ReplayReport(
        event="replay",
        unix_ns=t0_unix_ns + last_ns,
        t_s=last_ns / 1e9,
        age_s=0.0,
        is_whole=False,
        validity="valid" if any(load.validity == "valid" for load in loads) else "withheld",
        withheld_by=tuple(check.check for check in found.verdict.list_withholding_checks("mass")),
        loads=loads,
        turning_validity=(
            "none_yet" if turning is None else "withheld" if inertia is None else "valid"
        ),
        inertia_z_kg_m2=inertia,
        inertia_u_kg_m2=replace_nonfinite_by_none(turning["inertia_z_std_kg_m2"])
        if turning
        else None,
        fingerprint=found.fingerprint.results if found.fingerprint else "",
    )


def select_fit_with_inertia(planar: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """The fit that gives an inertia, all motion preferred to arcs; without one, the first fit."""
    fits = [row for kind in _FITS_OF_TURNING for row in planar if row["kind"] == kind]
    has_inertia = (
        row for row in fits if replace_nonfinite_by_none(row["inertia_z_kg_m2"]) is not None
    )
    return next(has_inertia, fits[0] if fits else None)


def iter_load_reports(answer: Answer, t0_unix_ns: int) -> Iterator[LoadReport]:
    """Yield the load states of an answer that have a time."""
    for row in answer.loads:
        if row["start_t_ns"] is None:
            continue  # nothing was fitted
        mass_kg, u_kg = row["mass_kg"], row["u_kg"]
        is_valid = not row["withheld"] and None not in (mass_kg, u_kg) and isfinite(mass_kg + u_kg)
        numbers = {
            "mass_kg": mass_kg,
            "mass_u_kg": u_kg,
            "payload_kg": row["payload_kg"],
            "payload_u_kg": row["payload_u_kg"],
            "friction_x_N_s_m": row["friction_x_N_s_m"],
            "friction_u_N_s_m": row["friction_x_std_N_s_m"],
        }
        yield LoadReport(
            load_id=row["load_id"],
            start_unix_ns=t0_unix_ns + row["start_t_ns"],
            end_unix_ns=t0_unix_ns + row["end_t_ns"],
            manoeuvres=row["manoeuvres"],
            validity="valid" if is_valid else "withheld",
            withheld_by=row["withheld_for"],
            empty=row["empty"],
            **{
                name: replace_nonfinite_by_none(value) if is_valid else None
                for name, value in numbers.items()
            },
        )


def replace_nonfinite_by_none(value: float | None) -> float | None:
    """The number, or None if it is not finite, which JSON does not allow."""
    return value if value is not None and isfinite(value) else None
