"""Force against acceleration: what the mass is the slope of, coloured by the gate."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.run_record import Run
from analysis.model.windows import samples_of
from recordings.report import colours
from recordings.report.number_text import plus_minus

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_X: Final = "regressor_acc_x_m_s2"
_NEEDED: Final = ("force_x_N", _X, "speed_x_m_s")
#: More points than this are drawn as a density.
_POINTS: Final = 20_000
_GRID: Final = 90
_SMALL: Final = 8
_ACCEPTED: Final = "#2e9e5b"
#: Reasons that are named beside the accepted; the rest is "other".
_REASONS: Final = 3


def draw_force_acceleration(axes: "Axes", run: Run, at_s: float | None = None) -> None:
    """Draw the force, less friction where the answer has it, against the regressor.

    The lines are the masses of the answer with two standard uncertainties: of the load at the
    moment, else of the lightest and the heaviest.

    Args:
        axes: where to.
        run: the run, or a stretch of it.
        at_s: the moment that is meant; its window is ringed.
    """
    points = _select_points(run)
    if points is None or not points.height:
        axes.text(0.5, 0.5, "no force and acceleration", ha="center", transform=axes.transAxes)
        return
    loads = _fitted_lines(run, at_s)
    friction = next((row["friction_x_N_s_m"] for row in loads), None)
    coulomb = _coulomb_force(run) if friction is not None else 0.0
    y = pl.col("force_x_N") - (friction or 0.0) * pl.col("speed_x_m_s")
    # a shift has millions of rows: no more columns than are drawn
    points = points.select(
        "t_ns",
        _X,
        (y - coulomb * pl.col("direction_x_1")).alias("y"),
        "used",
        pl.when(~pl.col("used") & (pl.col("phase") != "standstill")).then("reason").alias("why"),
    )
    counts = points["why"].drop_nulls().value_counts(sort=True)
    named = [str(reason) for reason in counts["why"].head(_REASONS)]
    drawn = points.select(_X, "y")
    chosen = {reason: (points["why"] == reason).fill_null(value=False) for reason in named}
    rest = ~points["used"]
    for each in chosen.values():
        rest &= ~each
    groups = [("other" if named else "not used", drawn.filter(rest), colours.OTHER)]
    for reason, rows in chosen.items():
        colour = colours.STATES.get(reason, colours.OTHER)
        groups.append((reason.replace("_", " "), drawn.filter(rows), colour))
    groups.append(("accepted", drawn.filter(points["used"]), _ACCEPTED))
    for label, group, colour in groups:
        if group.height:
            _draw_cloud(axes, group, colour, f"{label} ({group.height / points.height:.0%})")
    _draw_ring(axes, run, points, at_s)
    for number, row in enumerate(loads):
        name = ("lightest load", "heaviest load")[number] if len(loads) > 1 else "mass"
        _draw_line(axes, row, name, "-" if number else "--" if len(loads) > 1 else "-")
    axes.set_xlabel("acceleration that multiplies the mass (m/s²)", fontsize=_SMALL)
    less = "less friction " if friction is not None else ""
    axes.set_ylabel(f"force {less}(N)", fontsize=_SMALL)
    axes.tick_params(labelsize=_SMALL)
    axes.grid(alpha=0.25, lw=0.5)
    axes.legend(
        fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, markerscale=2
    )


def _select_points(run: Run) -> pl.DataFrame | None:
    """Samples with force and acceleration, whether a window used them, and the gate's reason."""
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
        window = run.provenance.settings.gate.window_samples
        used = samples_of(gate["accepted_x"].fill_null(value=False).to_numpy(), window)
        points = points.with_columns(pl.Series("used", used), gate["reason_x"].alias("reason"))
    return points.drop_nulls(list(_NEEDED)).with_columns(pl.col("direction_x_1").fill_null(0.0))


def _fitted_lines(run: Run, at_s: float | None) -> list[dict[str, Any]]:
    """The loads whose masses are drawn as lines."""
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


def _coulomb_force(run: Run) -> float:
    """Coulomb friction of the answer."""
    terms = run.frames.get("nuisances")
    if terms is None:
        return 0.0
    found = terms.filter(pl.col("term") == "direction")["posterior"].to_list()
    return float(found[0] or 0.0) if found else 0.0


def _draw_cloud(axes: "Axes", group: pl.DataFrame, colour: str, label: str) -> None:
    x, y = group[_X].to_numpy(), group["y"].to_numpy()
    if group.height <= _POINTS:
        axes.plot(x, y, ".", ms=4, color=colour, alpha=0.5, mew=0, label=label)
        return
    from matplotlib.colors import to_rgb

    count, x_edges, y_edges = np.histogram2d(x, y, bins=_GRID)
    # logarithmic, or a standstill outshines all else
    strength = np.log1p(count.T) / np.log1p(count.max())
    image = np.empty((*strength.shape, 4))
    image[..., :3] = to_rgb(colour)
    image[..., 3] = np.where(strength > 0, 0.25 + 0.6 * strength, 0.0)
    extent = (x_edges[0], x_edges[-1], y_edges[0], y_edges[-1])
    axes.imshow(image, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
    axes.plot([], [], ".", ms=4, color=colour, label=label)
    # an image pins the axes to itself, while others may reach further
    axes.autoscale(enable=True)


def _draw_ring(axes: "Axes", run: Run, points: pl.DataFrame, at_s: float | None) -> None:
    """The window that ends at the moment."""
    if at_s is None:
        return
    settings = run.provenance.settings
    end = round(at_s * 1e9)
    length = round(1e9 * settings.gate.window_samples / settings.align.rate_hz)
    window = points.filter(pl.col("t_ns").is_between(end - length, end, closed="right"))
    if window.height:
        axes.plot(
            window[_X].to_numpy(),
            window["y"].to_numpy(),
            "-",
            color="black",
            lw=0.7,
            alpha=0.8,
            label=f"the window that ends at {at_s:g} s",
        )


def _draw_line(axes: "Axes", row: dict[str, Any], name: str, dashes: str) -> None:
    ends: NDArray[np.float64] = np.array(axes.get_xlim())
    mass, u = row["mass_kg"], row["u_kg"] or 0.0
    label = f"{name} {plus_minus(mass, 2 * u)} kg (k = 2)"
    axes.plot(ends, mass * ends, dashes, color="black", lw=1.2, label=label)
    axes.fill_between(
        ends, (mass - 2 * u) * ends, (mass + 2 * u) * ends, color="black", alpha=0.15, lw=0
    )
    axes.set_xlim(float(ends[0]), float(ends[1]))
