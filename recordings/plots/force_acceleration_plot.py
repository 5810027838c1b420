"""Plot force against acceleration, whose slope is the mass, coloured by gate decision."""

from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.run_record import Run
from recordings.plots.plot_limits import LIMITS
from recordings.report.force_acceleration import (
    ACCELERATION,
    ACCELERATION_LABEL,
    FORCE,
    MassLine,
    PointGroup,
    select_force_acceleration_data,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_force_acceleration(axes: "Axes", run: Run, at_s: float | None = None) -> None:
    """Plot the force, minus friction if it is estimated, against the acceleration.

    Lines show masses with two standard uncertainties: that of the load at the moment, or those of
    the lightest and the heaviest load.

    Args:
        axes: axes to draw on.
        run: run, or part of one.
        at_s: moment whose window is marked with rings.
    """
    found = select_force_acceleration_data(run, at_s)
    if found is None:
        axes.text(0.5, 0.5, "no force and acceleration", ha="center", transform=axes.transAxes)
        return
    for group in found.groups:
        _draw_points_of_group(axes, group)
    _circle_points_of_window(axes, run, found.points, at_s)
    for number, line in enumerate(found.masses):
        _draw_mass_line(axes, line, "--" if len(found.masses) > 1 and not number else "-")
    axes.set_xlabel(ACCELERATION_LABEL, fontsize=LIMITS.small_type_pt)
    axes.set_ylabel(found.force_label, fontsize=LIMITS.small_type_pt)
    axes.tick_params(labelsize=LIMITS.small_type_pt)
    axes.grid(alpha=0.25, lw=0.5)
    axes.legend(
        fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, markerscale=2
    )


def _draw_points_of_group(axes: "Axes", group: PointGroup) -> None:
    x, y = group.points[ACCELERATION].to_numpy(), group.points[FORCE].to_numpy()
    if x.size <= LIMITS.scatter_max_points:
        axes.plot(x, y, ".", ms=4, color=group.colour, alpha=0.5, mew=0, label=group.label)
        return
    from matplotlib.colors import to_rgb

    count, x_edges, y_edges = np.histogram2d(x, y, bins=LIMITS.density_cells)
    # logarithmic, else a standstill would dominate the picture
    strength = np.log1p(count.T) / np.log1p(count.max())
    image = np.empty((*strength.shape, 4))
    image[..., :3] = to_rgb(group.colour)
    image[..., 3] = np.where(strength > 0, 0.25 + 0.6 * strength, 0.0)
    extent = (x_edges[0], x_edges[-1], y_edges[0], y_edges[-1])
    axes.imshow(image, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
    axes.plot([], [], ".", ms=4, color=group.colour, label=group.label)
    # an image fixes the axes to its own extent, but other artists may extend further
    axes.autoscale(enable=True)


def _circle_points_of_window(
    axes: "Axes", run: Run, points: pl.DataFrame, moment_s: float | None
) -> None:
    """Draw rings around the points of the window that ends at the moment."""
    if moment_s is None:
        return
    settings = run.provenance.settings
    end = round(moment_s * 1e9)
    length = round(1e9 * settings.gate.window_samples / settings.align.rate_hz)
    window = points.filter(pl.col("t_ns").is_between(end - length, end, closed="right"))
    if window.height:
        axes.plot(
            window[ACCELERATION].to_numpy(),
            window[FORCE].to_numpy(),
            "-",
            color="black",
            lw=0.7,
            alpha=0.8,
            label=f"the window that ends at {moment_s:g} s",
        )


def _draw_mass_line(axes: "Axes", mass_line: MassLine, dashes: str) -> None:
    ends: NDArray[np.float64] = np.array(axes.get_xlim())
    mass, u = mass_line.mass_kg, mass_line.u_kg
    axes.plot(ends, mass * ends, dashes, color="black", lw=1.2, label=mass_line.label)
    axes.fill_between(
        ends, (mass - 2 * u) * ends, (mass + 2 * u) * ends, color="black", alpha=0.15, lw=0
    )
    axes.set_xlim(float(ends[0]), float(ends[1]))
