"""The layout that a recording opens in: the tabs of the table, without what this run lacks."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.run import Run
from recordings import colours
from recordings.display import ROOT, Drawn, axis_range, drawn_of
from recordings.stored import entity_path
from recordings.table import TABS, TIME, Kind, Tab, View, component
from recordings.texts import texts

if TYPE_CHECKING:
    from rerun import blueprint as rrb
    from rerun.blueprint import Visualizer
    from rerun.blueprint.encodings import VisualizerComponentMapping
    from rerun.encodings import EntityPathLike

_LANE_SHARE: Final = 0.9


def blueprint(run: Run, shown: Mapping[str, pl.DataFrame]) -> "rrb.Blueprint":
    """Lay out a run in tabs, the overview first, with the whole log in view and time paused.

    Args:
        run: the run.
        shown: its `display_frames`.
    """
    import rerun.blueprint as rrb

    tabs = [laid_out for tab in TABS if (laid_out := _tab(tab, run, shown)) is not None]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0, name="payscope"),
        rrb.TimePanel(state="collapsed", timeline=TIME, play_state="paused"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def text_entity(name: str) -> str:
    """Where a text lies."""
    return entity_path(f"{ROOT}/text/{name}")


def _tab(tab: Tab, run: Run, shown: Mapping[str, pl.DataFrame]) -> "rrb.Container | None":
    import rerun.blueprint as rrb

    plots, shares = list[rrb.View](), list[float]()
    for view in tab.views:
        drawn = drawn_of(view, run, shown)
        if drawn:
            plots.append(_view(view, drawn, run))
            shares.append(_LANE_SHARE if view.kind is Kind.STATES else 1.0)
    documents = [
        rrb.TextDocumentView(origin=text_entity(name), name=name.capitalize())
        for name in tab.texts
        if name in texts(run)
    ]
    if plots and documents:
        column = rrb.Vertical(*plots, row_shares=shares)
        return rrb.Horizontal(*documents, column, column_shares=[2, 3], name=tab.name)
    if plots:
        return rrb.Vertical(*plots, row_shares=shares, name=tab.name)
    return rrb.Horizontal(*documents, name=tab.name) if documents else None


def _view(view: View, drawn: tuple[Drawn, ...], run: Run) -> "rrb.View":
    import rerun.blueprint as rrb
    from rerun.encodings import TimeRange, TimeRangeBoundary

    whole = TimeRange(start=TimeRangeBoundary.infinite(), end=TimeRangeBoundary.infinite())
    axis = rrb.TimeAxis(view_range=whole)
    overrides: dict[EntityPathLike, list[Visualizer]] = {}
    for each in drawn:
        overrides.setdefault(entity_path(each.frame), []).extend(_visualizers(view.kind, each))
    contents = [str(entity) for entity in overrides]
    if view.kind is Kind.STATES:
        return rrb.StateTimelineView(
            name=view.title, contents=contents, overrides=overrides, time_view=axis
        )
    bulk = axis_range(view, run)
    return rrb.TimeSeriesView(
        name=view.title,
        contents=contents,
        overrides=overrides,
        axis_x=axis,
        axis_y=rrb.ScalarAxis(range=bulk) if bulk is not None else None,
        # extremes of one line need no legend
        plot_legend=rrb.PlotLegend(visible=sum(not each.faint for each in drawn) > 1),
    )


def _visualizers(kind: Kind, drawn: Drawn) -> "Iterator[Visualizer]":
    import rerun as rr

    if kind is Kind.STATES:
        looks = rr.StateConfiguration(
            values=list(colours.STATES),
            labels=[state.replace("_", " ") for state in colours.STATES],
            colors=[_rgba(colour) for colour in colours.STATES.values()],
        )
        yield looks.visualizer(mappings=[_mapping("StateChange:state", drawn.column)])
        return
    colour = _rgba(drawn.colour, "60" if drawn.faint else "ff")
    scalars = _mapping("Scalars:scalars", drawn.column)
    if drawn.variance is not None:
        band = rr.Measurements.from_fields(names=drawn.label, colors=colour)
        values = _mapping("Measurements:values", drawn.column)
        variances = _mapping("Measurements:variances", drawn.variance)
        yield band.visualizer(mappings=[values, variances])
    else:
        width = 0.7 if drawn.faint else 1.5
        line = rr.SeriesLines(
            names=drawn.label,
            colors=colour,
            widths=width,
            aggregation_policy="MinMax",  # zoomed out, a mean would hide what it averages
        )
        yield line.visualizer(mappings=[scalars])
    if drawn.dotted:
        dots = rr.SeriesPoints(names=drawn.label, colors=colour, marker_sizes=3.0)
        yield dots.visualizer(mappings=[scalars])


def _rgba(colour: str, alpha: str = "ff") -> int:
    return int(colour[1:] + alpha, 16)


def _mapping(target: str, column: str) -> "VisualizerComponentMapping":
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    return VisualizerComponentMapping(
        target, ComponentSourceKind.SourceComponent, source_component=component(column)
    )
