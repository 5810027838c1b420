"""Write texts about the centre of mass: results of arcs and joint motion, what is undetermined."""

from collections.abc import Mapping, Sequence
from typing import Any

from analysis.model.run_record import Run
from estimators.errors import format_count
from recordings.report.number_text import (
    describe_missing_scale_uncertainties,
    format_markdown_table,
    format_number,
    format_plus_minus,
)
from recordings.report.report_limits import LIMITS

_OF = {"arcs": "all arcs together", "joint": "all motion together"}
_NAMES = {
    "mass": ("mass_kg", "mass_std_kg", "kg"),
    "yaw inertia": ("inertia_z_kg_m2", "inertia_z_std_kg_m2", "kg·m²"),
    "friction": ("friction_x_N_s_m", "friction_x_std_N_s_m", "N·s/m"),
    "friction of turning": ("friction_z_N_m_s", "friction_z_std_N_m_s", "N·m·s"),
}

#: Quantities whose largest uncertainty is stated in a line each, with words, factor and unit.
_SAID = {
    "inertia_z_kg_m2": ("the yaw inertia", 1.0, "kg·m²"),
    "com_x_m": ("the centre of mass ahead", 1e3, "mm"),
}


def describe_planar_fits(
    planar_rows: Sequence[Mapping[str, Any]], budget: Sequence[Mapping[str, Any]] = ()
) -> list[str]:
    """Describe each fit over several arcs, or else each arc, with the largest uncertainties."""
    whole = [row for row in planar_rows if row["kind"] in _OF] or list(planar_rows)
    return (
        [_describe_planar_fit(row) for row in whole]
        + describe_largest_uncertainty_parts(budget)
        + describe_uncertainties_missing_in_file(whole)
    )


def describe_largest_uncertainty_parts(
    uncertainty_budget: Sequence[Mapping[str, Any]],
) -> list[str]:
    """Describe the largest known part of each uncertainty in a line."""
    lines: list[str] = []
    for quantity, (words, factor, unit) in _SAID.items():
        known = [row for row in uncertainty_budget if row["quantity"] == quantity and row["u"]]
        if known:
            most = known[0]
            lines.append(
                f"the largest part of the ± of {words} is {most['cause']} "
                f"({factor * most['u']:.2g} {unit}: {most['meaning']}); to reduce it: "
                f"{most['shrinks']}"
            )
    return lines


def describe_uncertainties_missing_in_file(planar_rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Name uncertainties missing from the machine file; empty for recordings of old versions."""
    lines: list[str] = []
    for column, of in (
        ("scale_unknown", "yaw inertia and first moments"),
        ("com_scale_unknown", "the centre of mass"),
    ):
        names = (n for row in planar_rows for n in (row.get(column) or "").split(", ") if n)
        if missing := ", ".join(dict.fromkeys(names)):
            lines.append(describe_missing_scale_uncertainties(missing, of))
    return lines


def format_planar_markdown(run: Run) -> str:
    """Format every arc and joint fit in Markdown; empty if the machine did not turn."""
    rows = read_planar_rows(run)
    if not rows:
        return ""
    cells = [
        (
            row["kind"],
            f"{row['start_t_ns'] / 1e9:.2f} – {row['end_t_ns'] / 1e9:.2f}",
            row["speed_x_m_s"],
            row["yaw_rate_rad_s"],
            format_plus_minus(row["com_x_m"], row["com_x_std_m"]),
            format_plus_minus(row["com_y_m"], row["com_y_std_m"]),
            "withheld" if row["withheld"] else row["reason"].replace("_", " "),
        )
        for row in rows
    ]
    head = ("of", "s", "m/s", "rad/s", "ahead (m)", "to the left (m)", "outcome")
    parts = ["# Centre of mass", format_markdown_table(head, cells)]
    whole = [row for row in rows if row["kind"] in _OF]
    parts += [f"- {line}" for line in describe_uncertainties_missing_in_file(rows)]
    parts += [
        f"**{_OF[row['kind']].capitalize()}**: {list_determined_parameters_as_text(row)}"
        for row in whole
    ]
    if "planar_budget" in run.frames and not run.frames["planar_budget"].is_empty():
        sources = run.frames["planar_budget"].to_dicts()
        lines: dict[str, list[str]] = {}
        for row in sources:
            # smaller fractions of the variance are not listed
            if row["share_1"] is not None and row["share_1"] < LIMITS.small_variance_fraction:
                continue
            u = "not known" if row["u"] is None else f"{format_number(row['u'])} {row['unit']}"
            # a list, not a table, since the viewer wraps it
            line = f"- **{row['cause']}** ({row['kind']}): {u}; shrinks with {row['shrinks']}"
            lines.setdefault(row["quantity"], []).append(line)
        parts.append("## Where their uncertainty comes from")
        for quantity, listed in lines.items():
            parts += [f"### {quantity}", "\n".join(listed)]
    return "\n\n".join(parts)


def read_planar_rows(run: Run) -> list[dict[str, Any]]:
    """Read the rows of the frame `planar`; empty if the run lacks it."""
    return run.frames["planar"].to_dicts() if "planar" in run.frames else []


def _describe_planar_fit(planar_row: Mapping[str, Any]) -> str:
    of = _OF.get(planar_row["kind"], "one arc")
    if planar_row["withheld"]:
        return f"centre of mass from {of}: withheld"
    if planar_row["com_x_m"] is None:
        return f"centre of mass from {of}: none; {list_determined_parameters_as_text(planar_row)}"
    along = (
        f"{_format_distance(planar_row, 'x')} "
        f"{'ahead of' if planar_row['com_x_m'] >= 0 else 'behind'} the origin"
    )
    if planar_row["com_y_m"] is None:
        return f"centre of mass from {of}: {along}"
    across = (
        f"{_format_distance(planar_row, 'y')} to its "
        f"{'left' if planar_row['com_y_m'] >= 0 else 'right'}"
    )
    return f"centre of mass from {of}: {along}, {across}"


def _format_distance(planar_row: Mapping[str, Any], axis: str) -> str:
    return (
        f"{format_plus_minus(abs(planar_row[f'com_{axis}_m']), planar_row[f'com_{axis}_std_m'])} m"
    )


def list_determined_parameters_as_text(planar_row: Mapping[str, Any]) -> str:
    """List the parameters that the motion determines and that are not withheld."""
    values = [
        f"{name} {format_plus_minus(planar_row[value], planar_row[std])} {unit}"
        for name, (value, std, unit) in _NAMES.items()
        if planar_row[value] is not None
    ]
    said = [f"it determines {format_count(planar_row['rank'], 'number')}"]
    if planar_row["identifiable"]:
        said.append(f"by themselves {planar_row['identifiable']}")
    if planar_row["combinations"]:
        said.append(f"together only {planar_row['combinations']}")
    return "; ".join(said) + "." + (f" {', '.join(values)}." if values else "")
