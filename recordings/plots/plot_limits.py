"""Sizes of plots, and limits of what is drawn in them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PlotLimits:
    """Sizes of plots, and limits of what is drawn in them.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # convergence_plot
    #: Most points of a line: more than a page has pixels.
    line_max_points: int = 3000
    #: Size of small type, in points.
    small_type_pt: int = 8
    #: Number of loads up to which recursions are drawn: more lines would hide each other.
    recursion_max_loads: int = 12
    #: Margin above and below, as a fraction of the range.
    range_margin_fraction: float = 0.25

    # force_acceleration_plot
    #: Number of points beyond which they are drawn as a density.
    scatter_max_points: int = 20_000
    #: Cells of this density in each direction.
    density_cells: int = 90

    # run_plots
    #: Width of a page, in inches.
    page_width_in: float = 10.0
    #: Height of a panel, in inches.
    panel_height_in: float = 1.5
    #: Height of a line of text, in inches.
    line_height_in: float = 0.15
    #: Characters that fit on a line of the answer.
    line_characters: int = 140

    # sweep_figure
    #: Width of the figure of a sweep, in inches.
    sweep_width_in: float = 8.0
    #: Height of a panel of this figure, in inches.
    sweep_panel_height_in: float = 2.0
    #: Distance of the bars of two methods, as a fraction of the smallest step between values.
    bar_distance_fraction: float = 0.025
    #: Number of names up to which they are written horizontally, and not vertically.
    level_max_names: int = 5

    # time_panels
    #: Shortest time span of an axis, in ns, since a stretch may have a single sample.
    shortest_span_ns: int = 10_000_000
    #: Number of points beyond which they are drawn in bins.
    panel_max_points: int = 4000
    #: Number of state changes beyond which states are drawn as fractions of time.
    lane_max_spans: int = 300
    #: Number of bins of such points.
    panel_bins: int = 800
    #: Number of bins of such fractions.
    lane_bins: int = 160
    #: Characters of a line of an axis label.
    label_characters: int = 22
    #: Most states of a lane that a legend has room for.
    legend_max_states: int = 7


#: The values in use.
LIMITS: Final = PlotLimits()
