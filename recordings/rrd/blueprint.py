"""Lay out a recording by the table of views, without views for which the run has no data."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.model.run_record import Run
from recordings.report import colours
from recordings.report.finding_text import read_findings_of_run
from recordings.rrd.display_frames import (
    ROOT,
    DisplayColumn,
    choose_axis_range_without_outliers,
    find_time_span_of_grid_ns,
    list_displayed_columns,
)
from recordings.rrd.plane_pictures import PlanePicture
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.recording_table import TABS
from recordings.rrd.recording_views import MethodLayout, Tab, View, ViewKind
from recordings.rrd.stored_frames import make_entity_path
from recordings.rrd.stored_names import TIME, make_component_name

if TYPE_CHECKING:
    from rerun import blueprint as rrb
    from rerun.blueprint import Visualizer
    from rerun.blueprint.encodings import VisualizerComponentMapping
    from rerun.encodings import EntityPathLike

#: Prefix of the names of displayed frames of methods.
_ESTIMATES: Final = f"{ROOT}/estimates/"
#: Method that represents several methods, since it converges over the log, as on board.
_LEADING_METHOD: Final = "rls"


@dataclass(frozen=True, slots=True)
class Panel:
    """A view to draw: its series, and the range of most of its values."""

    title: str
    kind: ViewKind
    columns: tuple[DisplayColumn, ...]
    axis_range: tuple[float, float] | None = None
    shares_legend_of_panel_above: bool = False
    """Whether the panel above names its lines as well."""

    @property
    def has_legend(self) -> bool:
        """Whether its lines need labels; the extremes of a single line do not."""
        lines = sum(not each.faint for each in self.columns)
        return (
            self.kind is not ViewKind.STATES and lines > 1 and not self.shares_legend_of_panel_above
        )

    @property
    def plot_height_fraction(self) -> float:
        """Fraction of a page's height that the plot needs to show its legend."""
        # lines of the same name have one entry
        names = len({each.label for each in self.columns}) if self.has_legend else 1
        return (LIMITS.plot_margin + LIMITS.legend_name_height * names) / LIMITS.page_height

    @property
    def lanes_height_fraction(self) -> float:
        """Fraction of a page's height that its lanes need; 0 for a plot."""
        if self.kind is not ViewKind.STATES:
            return 0.0
        return (LIMITS.lanes_margin + LIMITS.lane_height * len(self.columns)) / LIMITS.page_height


#: Panels side by side.
Row = tuple[Panel, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """A tab to draw: panels or rows of panels from top to bottom, with texts."""

    name: str
    panels: tuple[Panel | Row, ...] = ()
    texts: tuple[str, ...] = ()
    events: bool = False
    pictures: tuple[tuple[str, str], ...] = ()
    """Name and title of each, below the panels."""

    @property
    def panel_rows(self) -> list[Row]:
        """Panels row by row."""
        return [each if isinstance(each, tuple) else (each,) for each in self.panels]


def lay_out_run_in_tabs(
    run: Run,
    display_frames: Mapping[str, pl.DataFrame],
    texts: Collection[str],
    pictures: Mapping[str, PlanePicture],
    parent_entity: str = "",
) -> "rrb.Blueprint":
    """Lay out a run in tabs, the overview first, with the whole log in view and time paused.

    Args:
        run: the run.
        display_frames: frames from `make_display_frames`.
        texts: names of the run's texts.
        pictures: pictures from `make_plane_pictures`.
        parent_entity: parent entity; empty for none.
    """
    pages = [
        Page(
            tab.name,
            make_panels_of_tab(tab, run, display_frames),
            tuple(name for name in tab.texts if name in texts),
            events=tab.events and bool(read_findings_of_run(run)),
            pictures=tuple(
                (name, pictures[name].title) for name in tab.pictures if name in pictures
            ),
        )
        for tab in TABS
        # a tab of findings is omitted if there are none
        if not tab.events or read_findings_of_run(run)
    ]
    return lay_out_pages_as_tabs(pages, find_unix_span_of_grid_ns(run), parent_entity)


def make_panels_of_tab(
    tab: Tab, run: Run, display_frames: Mapping[str, pl.DataFrame]
) -> tuple[Panel | Row, ...]:
    """Make panels of a tab's views for which this run has data in `display_frames`.

    Returns:
        Panels, or rows of panels; none if only the tab's context has data.
    """
    found = [
        (view, panel)
        for view in tab.views
        if (panel := _make_panel_of_view(view, run, display_frames))
    ]
    if all(view in tab.context for view, _ in found):
        return ()
    by_method = [_split_panel_by_method(panel) for _, panel in found]
    if tab.methods is MethodLayout.ROWS:
        methods = dict.fromkeys(method for panels in by_method for method in panels)
        return tuple(
            tuple(panels[method] for panels in by_method if method in panels) for method in methods
        )
    return tuple(panels.get(_LEADING_METHOD, next(iter(panels.values()))) for panels in by_method)


def _make_panel_of_view(
    view: View, run: Run, display_frames: Mapping[str, pl.DataFrame]
) -> Panel | None:
    drawn = list_displayed_columns(view, run, display_frames)
    return (
        Panel(view.title, view.kind, drawn, choose_axis_range_without_outliers(view, run))
        if drawn
        else None
    )


def _split_panel_by_method(panel: Panel) -> dict[str, Panel]:
    """Split a panel into one per method on a common axis; one unnamed panel for a single method."""
    by_frame: dict[str, list[DisplayColumn]] = {}
    for each in panel.columns:
        by_frame.setdefault(each.frame, []).append(each)
    if len(by_frame) < 2 or not all(frame.startswith(_ESTIMATES) for frame in by_frame):
        return {"": panel}
    return {
        (method := frame.removeprefix(_ESTIMATES)): replace(
            panel, title=f"{panel.title}, {method}", columns=tuple(drawn)
        )
        for frame, drawn in by_frame.items()
    }


def find_unix_span_of_grid_ns(run: Run) -> tuple[int, int] | None:
    """Find the first and last Unix time in ns of a run's grid; None without a grid."""
    span, t0_ns = find_time_span_of_grid_ns(run), run.provenance.t0_unix_ns
    return None if span is None else (span[0] + t0_ns, span[1] + t0_ns)


def lay_out_pages_as_tabs(
    pages: Sequence[Page],
    span_ns: tuple[int, int] | None,
    parent_entity: str = "",
    *,
    is_growing: bool = False,
) -> "rrb.Blueprint":
    """Lay out pages as tabs, of which the first is open; empty pages are omitted.

    Args:
        pages: the pages.
        span_ns: visible Unix times in ns; None for all.
        parent_entity: parent entity; empty for none.
        is_growing: whether the time cursor follows the newest row.
    """
    import rerun.blueprint as rrb

    tabs = [
        tab
        for page in pages
        if (tab := _make_tab_of_page(page, span_ns, parent_entity)) is not None
    ]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0, name="payscope"),
        rrb.TimePanel(
            state="collapsed",
            timeline=TIME,
            play_state="following" if is_growing else "paused",
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def make_text_entity_path(name: str, parent_entity: str = "") -> str:
    """Make the entity path of a text."""
    return make_entity_path(f"{ROOT}/text/{name}", parent_entity)


def make_picture_entity_path(name: str, parent_entity: str = "") -> str:
    """Make the entity path of a picture."""
    return make_entity_path(f"{ROOT}/picture/{name}", parent_entity)


def make_events_entity_path(parent_entity: str = "") -> str:
    """Make the entity path of the events."""
    return make_entity_path(f"{ROOT}/events", parent_entity)


def _make_tab_of_page(
    page: Page, span_ns: tuple[int, int] | None, parent_entity: str
) -> "rrb.Container | None":
    import rerun.blueprint as rrb

    has_legend = any(panel.has_legend for row in page.panel_rows for panel in row)
    axis = _make_time_axis(
        span_ns,
        (LIMITS.narrow_legend_room_fraction if page.texts else LIMITS.legend_room_fraction)
        if has_legend
        else 0.0,
    )
    plots = [
        _lay_out_views_side_by_side([_make_rerun_view(panel, axis, parent_entity) for panel in row])
        for row in page.panel_rows
    ]
    if page.events:
        plots.append(rrb.TextLogView(origin=make_events_entity_path(parent_entity), name="Events"))
    left, top, right, bottom = LIMITS.plane_bounds
    bounds = rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom])
    pictures = [
        rrb.Spatial2DView(
            origin=make_picture_entity_path(name, parent_entity), name=title, visual_bounds=bounds
        )
        for name, title in page.pictures
    ]
    documents = [
        rrb.TextDocumentView(
            origin=make_text_entity_path(name, parent_entity), name=name.capitalize()
        )
        for name in page.texts
    ]
    column = [*plots, *pictures]
    if column and documents:
        beside = rrb.Vertical(*column, row_shares=compute_relative_panel_heights(page))
        # tables beside pictures are wide
        shares = [1, 1] if pictures else [2, 3]
        return rrb.Horizontal(*documents, beside, column_shares=shares, name=page.name)
    if column:
        return rrb.Vertical(
            *column, row_shares=compute_relative_panel_heights(page), name=page.name
        )
    return rrb.Horizontal(*documents, name=page.name) if documents else None


def _lay_out_views_side_by_side(views: "list[rrb.View]") -> "rrb.View | rrb.Container":
    import rerun.blueprint as rrb

    return views[0] if len(views) == 1 else rrb.Horizontal(*views)


def compute_relative_panel_heights(page: Page) -> list[float]:
    """Compute relative heights of a page's panels, events and pictures.

    Lanes get the height they need; the other panels are equal, except for tall legends.
    """
    others = page.events + len(page.pictures)
    lanes = [max(panel.lanes_height_fraction for panel in row) for row in page.panel_rows] + [
        0.0
    ] * others
    shrunk = min(1.0, LIMITS.lanes_max_fraction / (sum(lanes) or 1.0))
    least = [max(panel.plot_height_fraction for panel in row) for row in page.panel_rows]
    least += [LIMITS.plot_margin / LIMITS.page_height] * others
    plots = [needed for needed, lane in zip(least, lanes, strict=True) if lane == 0.0]
    heights = iter(divide_height_with_minimums(plots, 1.0 - shrunk * sum(lanes)))
    return [shrunk * lane or next(heights) for lane in lanes]


def divide_height_with_minimums(min_heights: Sequence[float], total_height: float) -> list[float]:
    """Divide a height equally, but with a minimum for each; all shrink if there is too little."""
    if sum(min_heights) >= total_height:
        return [total_height * each / sum(min_heights) for each in min_heights]
    level, higher = total_height / max(len(min_heights), 1), 0
    while (count := sum(each > level for each in min_heights)) > higher:
        higher = count
        taken = sum(each for each in min_heights if each > level)
        level = (total_height - taken) / (len(min_heights) - higher)
    return [max(each, level) for each in min_heights]


def _make_time_axis(span_ns: tuple[int, int] | None, legend_fraction: float) -> "rrb.TimeAxis":
    """Make the time axis of a span, extended by the fraction `legend_fraction` for legends."""
    import rerun.blueprint as rrb
    from rerun.encodings import TimeRange, TimeRangeBoundary

    if span_ns is None or not legend_fraction:
        ends = TimeRangeBoundary.infinite(), TimeRangeBoundary.infinite()
    else:
        start, end = span_ns
        ends = (
            TimeRangeBoundary.absolute(nanos=start),
            TimeRangeBoundary.absolute(nanos=end + round(legend_fraction * (end - start))),
        )
    return rrb.TimeAxis(view_range=TimeRange(start=ends[0], end=ends[1]))


def _make_rerun_view(panel: Panel, time_axis: "rrb.TimeAxis", parent_entity: str) -> "rrb.View":
    import rerun.blueprint as rrb

    overrides: dict[EntityPathLike, list[Visualizer]] = {}
    for each in panel.columns:
        overrides.setdefault(make_entity_path(each.frame, parent_entity), []).extend(
            _iter_visualizers_of_column(panel.kind, each)
        )
    contents = [str(entity) for entity in overrides]
    if panel.kind is ViewKind.STATES:
        return rrb.StateTimelineView(
            name=panel.title, contents=contents, overrides=overrides, time_view=time_axis
        )
    return rrb.TimeSeriesView(
        name=panel.title,
        contents=contents,
        overrides=overrides,
        axis_x=time_axis,
        axis_y=rrb.ScalarAxis(range=panel.axis_range) if panel.axis_range is not None else None,
        plot_legend=rrb.PlotLegend("RightTop", visible=panel.has_legend),
    )


def _iter_visualizers_of_column(
    drawing_type: ViewKind, display_column: DisplayColumn
) -> "Iterator[Visualizer]":
    import rerun as rr

    if drawing_type is ViewKind.STATES:
        looks = rr.StateConfiguration(
            values=list(colours.make_colour_by_state()),
            labels=[state.replace("_", " ") for state in colours.make_colour_by_state()],
            colors=[
                colours.pack_colour_as_rgba(colour)
                for colour in colours.make_colour_by_state().values()
            ],
        )
        yield looks.visualizer(
            mappings=[_map_component_to_column("StateChange:state", display_column.column)]
        )
        return
    colour = colours.pack_colour_as_rgba(
        display_column.colour, "60" if display_column.faint else "ff"
    )
    scalars = _map_component_to_column("Scalars:scalars", display_column.column)
    if display_column.variance is not None:
        band = rr.Measurements.from_fields(names=display_column.label, colors=colour)
        values = _map_component_to_column("Measurements:values", display_column.column)
        variances = _map_component_to_column("Measurements:variances", display_column.variance)
        yield band.visualizer(mappings=[values, variances])
    else:
        width = 0.7 if display_column.faint else 3.5 if display_column.wide else 1.5
        line = rr.SeriesLines(
            names=display_column.label,
            colors=colour,
            widths=width,
            aggregation_policy="MinMax",  # zoomed out, a mean would hide extremes
        )
        yield line.visualizer(mappings=[scalars])
    if display_column.dotted:
        dots = rr.SeriesPoints(names=display_column.label, colors=colour, marker_sizes=3.0)
        yield dots.visualizer(mappings=[scalars])


def _map_component_to_column(component: str, column: str) -> "VisualizerComponentMapping":
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    return VisualizerComponentMapping(
        component, ComponentSourceKind.SourceComponent, source_component=make_component_name(column)
    )
