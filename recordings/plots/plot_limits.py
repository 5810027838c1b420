"""Sizes of the plots, and limits of what is drawn in them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PlotLimits:
    """Sizes of the plots, and limits of what is drawn in them.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # convergence_plot
    #: Points of a line: more than a page has pixels.
    line_max_points: int = 3000
    #: Size of small type, in points.
    small_type_pt: int = 8
    #: Loads up to which the recursions are drawn: more lines hide each other.
    recursion_max_loads: int = 12
    #: Margin above and below, as a fraction of the range.
    range_margin_fraction: float = 0.25

    # force_acceleration_plot
    #: Points beyond which they are drawn as a density,
    scatter_max_points: int = 20_000
    #: which has so many cells either way.
    density_cells: int = 90

    # run_plots
    #: Width of a page, in inches,
    page_width_in: float = 10.0
    #: height of a panel,
    panel_height_in: float = 1.5
    #: and of a line of text.
    line_height_in: float = 0.15
    #: Characters that fit on a line of the answer.
    line_characters: int = 140

    # sweep_figure
    #: Width of the figure of a sweep, in inches,
    sweep_width_in: float = 8.0
    #: and height of a panel.
    sweep_panel_height_in: float = 2.0
    #: Distance of two methods' bars, as a fraction of the least step between values.
    bar_distance_fraction: float = 0.025
    #: Names up to which they are written level, and not on end.
    level_max_names: int = 5

    # time_panels
    #: Shortest time of an axis, in ns: a stretch may have one sample.
    shortest_span_ns: int = 10_000_000
    #: Points beyond which they are drawn by bins,
    panel_max_points: int = 4000
    #: and changes of state beyond which they are drawn as shares of time.
    lane_max_spans: int = 300
    #: Bins of such points,
    panel_bins: int = 800
    #: and of such shares.
    lane_bins: int = 160
    #: Characters of a line of an axis' name.
    label_characters: int = 22
    #: States of a lane that a legend has room for.
    legend_max_states: int = 7


#: The values in use.
LIMITS: Final = PlotLimits()
