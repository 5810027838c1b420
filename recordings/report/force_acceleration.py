"""Select the data of force against acceleration: points by gate decision, and lines of masses."""

from typing import Any, Final, NamedTuple

import polars as pl

from analysis.model.run_record import Run
from analysis.model.windows import mark_samples_in_accepted_windows
from recordings.report import colours
from recordings.report.number_text import format_plus_minus
from recordings.report.report_limits import LIMITS

#: Column of the excitation with the acceleration that multiplies the mass.
ACCELERATION: Final = "regressor_acc_x_m_s2"
#: Column with the force, minus friction if the answer has it.
FORCE: Final = "force_N"
ACCELERATION_LABEL: Final = "acceleration that multiplies the mass (m/s²)"
_NEEDED: Final = ("force_x_N", ACCELERATION, "speed_x_m_s")
_ACCEPTED: Final = "#2e9e5b"


class PointGroup(NamedTuple):
    """Points with the same gate decision: columns `ACCELERATION` and `FORCE`."""

    label: str
    colour: str
    points: pl.DataFrame


class MassLine(NamedTuple):
    """A mass of the answer with its standard uncertainty, drawn as a line."""

    name: str
    mass_kg: float
    u_kg: float

    @property
    def label(self) -> str:
        """Name, mass and expanded uncertainty of the line."""
        return f"{self.name} {format_plus_minus(self.mass_kg, 2 * self.u_kg)} kg (k = 2)"


class ForceAccelerationPlotData(NamedTuple):
    """Data of the plot of force against acceleration.

    Attributes:
        points: all points, with `t_ns`, `ACCELERATION` and `FORCE`.
        groups: the same points by gate decision.
        masses: mass of the load at the selected time, or of the lightest and the heaviest load.
        force_label: label of the force axis.
    """

    points: pl.DataFrame
    groups: list[PointGroup]
    masses: list[MassLine]
    force_label: str


def select_force_acceleration_data(
    run: Run, at_s: float | None = None
) -> ForceAccelerationPlotData | None:
    """Select the points and masses of a run for the plot.

    Args:
        run: the run, or a part of it.
        at_s: selected time in s; None for the whole run.

    Returns:
        The data; None if no sample has both force and acceleration.
    """
    points = select_force_acceleration_samples(run)
    if points is None or not points.height:
        return None
    loads = _select_loads_of_mass_lines(run, at_s)
    friction = next((row["friction_x_N_s_m"] for row in loads), None)
    coulomb = read_coulomb_friction_newtons(run) if friction is not None else 0.0
    force = pl.col("force_x_N") - (friction or 0.0) * pl.col("speed_x_m_s")
    # only the drawn columns, since a shift has millions of rows
    points = points.select(
        "t_ns",
        ACCELERATION,
        (force - coulomb * pl.col("direction_x_1")).alias(FORCE),
        "used",
        pl.when(~pl.col("used") & (pl.col("phase") != "standstill")).then("reason").alias("why"),
    )
    names = ("lightest load", "heaviest load") if len(loads) > 1 else ("mass",)
    masses = [
        MassLine(name, row["mass_kg"], row["u_kg"] or 0.0)
        for name, row in zip(names, loads, strict=False)
    ]
    less = "less friction " if friction is not None else ""
    return ForceAccelerationPlotData(
        points, _group_points_by_gate_reason(points), masses, f"force {less}(N)"
    )


def _group_points_by_gate_reason(points: pl.DataFrame) -> list[PointGroup]:
    counts = points["why"].drop_nulls().value_counts(sort=True)
    named = [str(reason) for reason in counts["why"].head(LIMITS.named_reasons)]
    drawn = points.select(ACCELERATION, FORCE)
    chosen = {reason: (points["why"] == reason).fill_null(value=False) for reason in named}
    rest = ~points["used"]
    for each in chosen.values():
        rest &= ~each
    groups = [("other" if named else "not used", colours.OTHER, rest)]
    for reason, rows in chosen.items():
        groups.append((reason.replace("_", " "), colours.STATES.get(reason, colours.OTHER), rows))
    groups.append(("accepted", _ACCEPTED, points["used"]))
    return [
        PointGroup(f"{label} ({rows.sum() / points.height:.0%})", colour, drawn.filter(rows))
        for label, colour, rows in groups
        if rows.any()
    ]


def select_force_acceleration_samples(run: Run) -> pl.DataFrame | None:
    """Select samples with force and acceleration, whether they were used, and the gate's reason."""
    excitation, gate = run.frames.get("excitation"), run.frames.get("gate")
    if excitation is None or any(name not in excitation.columns for name in _NEEDED):
        return None
    columns = [name for name in (*_NEEDED, "direction_x_1") if name in excitation.columns]
    points = excitation.select("t_ns", *columns, "phase")
    if "direction_x_1" not in columns:
        points = points.with_columns(direction_x_1=pl.col("speed_x_m_s").sign())
    if gate is None or gate.height != excitation.height or "accepted_x" not in gate.columns:
        points = points.with_columns(used=pl.lit(value=False), reason=pl.lit("not judged"))
    else:
        used = mark_samples_in_accepted_windows(
            gate["accepted_x"].fill_null(value=False).to_numpy(),
            estimate_rows_per_window(run, gate),
        )
        points = points.with_columns(pl.Series("used", used), gate["reason_x"].alias("reason"))
    return points.drop_nulls(list(_NEEDED)).with_columns(pl.col("direction_x_1").fill_null(0.0))


def estimate_rows_per_window(run: Run, gate_frame: pl.DataFrame) -> int:
    """Estimate the number of rows in a window, since a review keeps only some of the rows."""
    settings = run.provenance.settings
    step_ns = gate_frame["t_ns"].diff().median()
    if not isinstance(step_ns, float) or step_ns <= 0.0:
        return settings.gate.window_samples
    window_ns = 1e9 * settings.gate.window_samples / settings.align.rate_hz
    return max(round(window_ns / step_ns), 1)


def _select_loads_of_mass_lines(run: Run, at_s: float | None) -> list[dict[str, Any]]:
    """Select the loads whose masses are drawn as lines, the lighter first."""
    loads = run.frames.get("loads")
    if loads is None:
        return []
    known = loads.drop_nulls(["mass_kg", "friction_x_N_s_m"])
    if at_s is not None:
        at = round(at_s * 1e9)
        here = known.filter(pl.lit(at).is_between(pl.col("start_t_ns"), pl.col("end_t_ns")))
        known = here if here.height else known
    if known.height > 1:
        known = known.sort("mass_kg")
        known = pl.concat([known.head(1), known.tail(1)])
    return known.to_dicts()


def read_coulomb_friction_newtons(run: Run) -> float:
    """Read the Coulomb friction of the answer in N; 0 if it has none."""
    terms = run.frames.get("nuisances")
    if terms is None:
        return 0.0
    found = terms.filter(pl.col("term") == "direction")["posterior"].to_list()
    return float(found[0] or 0.0) if found else 0.0
