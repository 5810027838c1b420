"""Write lines about the answer: loads, payloads, sensitivity to priors, largest uncertainty."""

from collections.abc import Mapping
from math import ceil, hypot
from statistics import fmean
from typing import Any, Final, NamedTuple

from analysis.model.answer import Answer
from analysis.model.physical_units import NS_PER_S
from estimators.errors import format_count
from recordings.report.number_text import (
    SCALE_NOT_KNOWN,
    describe_missing_scale_uncertainties,
    format_plus_minus,
    round_to_uncertainty,
)
from recordings.report.report_limits import LIMITS
from recordings.report.shift_text import describe_min_detectable_load, may_miss_small_loads

#: Coverage factor of a normal distribution's interval of 95 %.
COVERAGE: Final = 1.96

_HEADS: Final = ("load", "from s", "to s", "manoeuvres", "mass kg", "payload kg")
_CALIBRATED: Final = ("calibrated kg", "from kg", "to kg")


def make_load_table_heads(answer: Answer) -> tuple[str, ...]:
    """Make the column heads of `make_load_table_rows`."""
    return (*_HEADS, *(_CALIBRATED if _has_calibrated_masses(answer) else ()), "")


def _has_calibrated_masses(answer: Answer) -> bool:
    return any("calibrated_kg" in load for load in answer.loads)


def make_load_table_rows(answer: Answer) -> list[tuple[str, ...]]:
    """Make a row per load: number, start, end, manoeuvres, mass, payload, remark.

    With a calibration, the calibrated mass and its interval precede the remark.
    """
    return [
        (
            str(load["load_id"]),
            _format_seconds_from_start(load["start_t_ns"]),
            _format_seconds_from_start(load["end_t_ns"]),
            str(load["manoeuvres"]),
            "–" if load["mass_kg"] is None else format_plus_minus(load["mass_kg"], load["u_kg"]),
            _format_payload_or_reason(load),
            *(make_calibrated_mass_cells(load) if _has_calibrated_masses(answer) else ()),
            _make_load_remark(load),
        )
        for load in answer.loads
    ]


def describe_loads_as_lines(answer: Answer, max_loads: int) -> list[str]:
    """Describe each load in a line, up to `max_loads`; a last line counts the others."""
    lines: list[str] = []
    rows = zip(make_load_table_rows(answer)[:max_loads], answer.loads, strict=False)
    for (load, start, end, manoeuvres, mass, payload, *_, remark), row in rows:
        carried = payload if payload in ("empty", "–") else f"payload {payload} kg"
        masses = ", ".join(
            filter(None, (f"{mass} kg", carried, describe_calibrated_mass(row), remark))
        )
        lines.append(f"load {load}: {start} to {end} s, {manoeuvres} manoeuvres, {masses}")
    if len(answer.loads) > max_loads:
        lines.append(f"and {len(answer.loads) - max_loads} more")
    return lines


def describe_answer_as_lines(answer: Answer, *, is_brief: bool = False) -> list[str]:
    """Describe masses, payloads and their caveats in lines, or why there is no answer."""
    if len(answer.loads) == 1:
        return describe_load_as_lines(answer.loads[0], is_brief=is_brief)
    lines = [f"{len(answer.loads)} load states; masses are listed per load"] if answer.loads else []
    empty = [load for load in answer.loads if load.get("empty")]
    mass = _describe_empty_mass(answer)
    if len(empty) == 1:
        lines.append(
            f"payloads are differences to load {empty[0]['load_id']}, taken as empty{mass}; if "
            "another is, give its time span with --empty FROM:TO"
        )
    elif empty:
        lines.append(
            f"payloads are differences to {len(empty)} loads taken as empty{mass}; if others "
            "are, give their time span with --empty FROM:TO"
        )
    known = [load for load in answer.loads if load["mass_kg"] is not None]
    return lines + (_list_notes_on_load(known[0]) if known else [])


def _describe_empty_mass(answer: Answer) -> str:
    """Mass of the loads taken as empty, in brackets; of several only if it is not the stated one.

    Their errors are mostly common, so that the mean has their uncertainty.
    """
    weighed = [load for load in answer.loads if load.get("empty") and load["mass_kg"] is not None]
    if not weighed:
        return ""
    mass_kg, u_kg = (fmean(load[name] for load in weighed) for name in ("mass_kg", "u_kg"))
    shown = f"{format_plus_minus(mass_kg, u_kg)} kg{' on average' * (len(weighed) > 1)}"
    if answer.stated_empty_mass is not None:
        stated_kg, stated_u_kg = answer.stated_empty_mass
        if abs(mass_kg - stated_kg) > COVERAGE * hypot(u_kg, stated_u_kg):
            stated = round_to_uncertainty(stated_kg, u_kg)
            return f" ({shown}, while machine.empty_mass_kg is {stated} kg)"
    return f" ({shown})" if len(weighed) == 1 else ""


def describe_load_as_lines(load_row: Mapping[str, Any], *, is_brief: bool = False) -> list[str]:
    """Describe mass, payload and, unless brief, prior sensitivity; or why there is no mass."""
    if load_row.get("mass_kg") is None:
        return [f"no mass: {load_row.get('withheld_for') or 'nothing was fitted'}"]
    mass, u = load_row["mass_kg"], load_row["u_kg"]
    low, high = mass - COVERAGE * u, mass + COVERAGE * u
    lines = [
        f"mass {format_plus_minus(mass, u)} kg (standard uncertainty), 95 %: "
        f"{round_to_uncertainty(low, u)} to {round_to_uncertainty(high, u)} kg, from "
        f"{load_row['manoeuvres']} "
        f"{'manoeuvre' if load_row['manoeuvres'] == 1 else 'manoeuvres'}"
    ]
    lines += filter(None, [describe_calibrated_mass(load_row)])
    if load_row["payload_kg"] is not None:
        lines.append(f"payload {_format_payload_or_reason(load_row)} kg")
    if not is_brief:
        lines.append(describe_prior_sensitivity(load_row))
    return lines + _list_notes_on_load(load_row)


def describe_prior_sensitivity(load_row: Mapping[str, Any]) -> str:
    """Describe in a line the masses with priors half and twice as wide."""
    halved, doubled = (
        round_to_uncertainty(load_row[name], load_row["u_kg"])
        for name in ("mass_halved_priors_kg", "mass_doubled_priors_kg")
    )
    return f"prior sensitivity: {halved} kg (×½) … {doubled} kg (×2)"


def _list_notes_on_load(load_row: Mapping[str, Any]) -> list[str]:
    """List the notes on a load that apply to every load of the log."""
    lines = [load_row[name] for name in ("said", "calibrated_said") if load_row.get(name)]
    is_scaled = load_row.get("payload_to") is not None and not load_row.get("payload_scale_unknown")
    if load_row["scale_unknown"]:
        of = "masses; payloads are on the scale of the stated empty mass" if is_scaled else ""
        lines.append(describe_missing_scale_uncertainties(load_row["scale_unknown"], of))
    if load_row["braking_left_out"]:
        lines.append("braking and driving disagree about the mass, and braking was left out")
    return lines


def describe_manoeuvres_needed_for_goal(answer: Answer, goal_u_kg: float) -> list[str]:
    """Say for each load how many further manoeuvres would reach ± `goal_u_kg`."""
    lines: list[str] = []
    for load in answer.loads:
        if load["mass_kg"] is None or load.get("empty"):
            continue
        by_difference = load.get("payload_to") is not None
        name = "payload" if by_difference else "mass"
        u_kg = load["payload_u_kg" if by_difference else "u_kg"]
        random_kg = load["payload_u_random_kg" if by_difference else "u_random_kg"]
        common_kg = max(u_kg**2 - random_kg**2, 0.0) ** 0.5
        start = f"load {load['load_id']}: {name} ± {u_kg:.3g} kg "
        start += f"from {format_count(load['manoeuvres'], 'manoeuvre')}"
        if u_kg <= goal_u_kg:
            lines.append(f"{start}, already within ± {goal_u_kg:g} kg")
        elif common_kg >= goal_u_kg:
            causes = [
                source
                for source in answer.budget
                # common errors of masses cancel in a difference
                if not by_difference
                and source.get("load_id", 0) == load["load_id"]
                and source["kind"] != "random"
                and source["u_kg"]
            ]
            most = (
                f"; reduce first {causes[0]['cause']}, by {causes[0]['shrinks']}" if causes else ""
            )
            lines.append(
                f"{start}; more like these cannot reach ± {goal_u_kg:g} kg: their common "
                f"uncertainty is ± {common_kg:.3g} kg{most}"
            )
        else:
            times = random_kg**2 / (goal_u_kg**2 - common_kg**2)
            wanted = ceil(load["manoeuvres"] * times)
            which = " (and as many empty)" if by_difference else ""
            lines.append(f"{start}; {wanted} like these{which} would give ± {goal_u_kg:g} kg")
    return lines


class UncertaintyRow(NamedTuple):
    """Row of the uncertainty budget, as text.

    Attributes:
        source: source of uncertainty.
        kind: its kind.
        u_kg: standard uncertainty.
        variance_bar: bar for its fraction of the variance.
        remedy: how to reduce it.
    """

    source: str
    kind: str
    u_kg: str
    variance_bar: str
    remedy: str


def make_uncertainty_rows(answer: Answer, bar_character: str = "█") -> list[UncertaintyRow]:
    """Make the rows of the uncertainty budget of the load with the most manoeuvres."""
    shown = find_load_with_most_manoeuvres(answer)
    rows: list[UncertaintyRow] = []
    for source in answer.budget:
        if source.get("load_id", 0) != shown:
            continue
        share = source["share_1"]
        if source["u_kg"] is None:
            found = UncertaintyRow(
                source["cause"], source["kind"], "not known", "", source["shrinks"]
            )
            rows.append(found)
        elif share is not None and share >= LIMITS.small_variance_fraction:
            bar = bar_character * max(1, round(share * LIMITS.bar_characters))
            cells = (f"{bar} {share:.0%}", source["shrinks"])
            rows.append(
                UncertaintyRow(source["cause"], source["kind"], f"{source['u_kg']:.3g}", *cells)
            )
    return rows


def find_load_with_most_manoeuvres(answer: Answer) -> int:
    """Find the number of the first load with the most manoeuvres; 0 if no load has a mass."""
    known = [load for load in answer.loads if load["mass_kg"] is not None]
    return max(known, key=lambda load: load["manoeuvres"])["load_id"] if known else 0


#: Meaning of the scatter if it is its prior's, since there are too few manoeuvres to estimate it.
_SCATTER_UNKNOWN: Final = "an assumed disagreement of manoeuvres of one load"


def advise_to_reduce_uncertainty(answer: Answer) -> str | None:
    """Advise what would reduce the uncertainty most; None if that is not why there is no mass."""
    shown = find_load_with_most_manoeuvres(answer)
    known = [s for s in answer.budget if s["u_kg"] and s.get("load_id", 0) == shown]
    has_mass = any(load["mass_kg"] is not None for load in answer.loads)
    if not known or not (has_mass or answer.verdict.is_mass_too_uncertain):
        return None
    most = known[0]
    share = most["share_1"]
    part = "" if share is None else f", {share:.0%} of the variance"
    load = next(load for load in answer.loads if load["load_id"] == shown)
    assumed = most["cause"] == "scatter" and load.get("scatter_known") is False
    meaning = _SCATTER_UNKNOWN if assumed else most["meaning"]
    return f"largest contribution: {meaning} ({most['cause']}{part}); to reduce: {most['shrinks']}"


def _format_payload_or_reason(load_row: Mapping[str, Any]) -> str:
    if load_row["payload_kg"] is None:
        return "–"
    if load_row.get("empty"):
        return "empty"
    if load_row.get("calibrated_payload_kg") is not None:
        names = ("payload_kg", "payload_low_kg", "payload_high_kg")
        mass, low, high = (f"{load_row[f'calibrated_{name}']:,.1f}" for name in names)
        return f"{mass} ({low} to {high})"
    return format_plus_minus(load_row["payload_kg"], load_row["payload_u_kg"])


def make_calibrated_mass_cells(load_row: Mapping[str, Any]) -> tuple[str, ...]:
    """Make the table cells with the calibrated mass and the ends of its interval."""
    names = ("calibrated_kg", "calibrated_low_kg", "calibrated_high_kg")
    return tuple("–" if load_row[name] is None else f"{load_row[name]:,.1f}" for name in names)


def describe_calibrated_mass(load_row: Mapping[str, Any]) -> str:
    """Describe the calibrated mass in a line; empty without a calibration."""
    if "calibrated_kg" not in load_row:
        return ""
    if load_row["calibrated_kg"] is None:
        return f"not calibrated: {load_row['calibrated_reason']}"
    mass, low, high = make_calibrated_mass_cells(load_row)
    unlike_kg = load_row.get("calibrated_unlike_u_kg") or 0.0
    # a smaller part has hardly any effect on the whole
    tells = unlike_kg > LIMITS.unlike_driving_fraction * load_row["calibrated_u_kg"]
    more = f"; ± {unlike_kg:,.1f} kg of that from driving unlike the campaign's" if tells else ""
    return f"calibrated {mass} kg, {low} to {high} kg{more}"


def _make_load_remark(load_row: Mapping[str, Any]) -> str:
    """Say why a load has no mass, repeatability or calibration; empty otherwise."""
    if load_row["mass_kg"] is None:
        return load_row["withheld_for"]
    if load_row.get("scatter_known") is False:
        return "repeatability unknown"
    if load_row.get("calibrated_reason"):
        return f"not calibrated: {load_row['calibrated_reason']}"
    return ""


def _format_seconds_from_start(t_ns: int | None) -> str:
    return "–" if t_ns is None else f"{t_ns / NS_PER_S:,.1f}"


def describe_shift_total(answer: Answer) -> list[str]:
    """Describe the total payload of the log's cycles in a line; no line if nothing was dumped."""
    shift = answer.shift
    if not shift:
        return []
    u_kg = 2.0 * shift["payload_u_kg"]
    total = ""
    # recordings of earlier versions have no total
    if shift.get("total_kg") is not None and shift["total_kg"] != shift["payload_kg"]:
        total = (
            f"; in the shift {shift['total_kg'] / 1e3:,.3f} ± "
            f"{2.0 * shift['total_u_kg'] / 1e3:.3f} t including what is not counted"
        )
    scale = f", {SCALE_NOT_KNOWN}" if shift.get("scale_unknown") else ""
    missed = f"; {describe_min_detectable_load(shift)}" if may_miss_small_loads(shift) else ""
    return [
        f"{format_count(shift['cycles_counted'], 'cycle')}, {shift['payload_kg'] / 1e3:,.3f} ± "
        f"{u_kg / 1e3:.3f} t (k = 2), {2.0 * shift['payload_u_common_kg'] / 1e3:.3f} t of that "
        f"common to all{total}{scale}{missed}; `payscope review` lists them"
    ]
