"""Views of a recording, and tabs of views."""

from dataclasses import dataclass
from enum import Enum

from analysis.model.schema import find_frame_declaration


class ViewKind(Enum):
    """Kind of a view, which determines how it draws its series."""

    LINES = "lines"
    BANDS = "a line with a ±1σ band"
    STATES = "one lane per series, coloured by state"


@dataclass(frozen=True, slots=True)
class ViewSeries:
    """A column of a frame; `frame` "estimates" stands for every `estimates/<method>`.

    The label of a lane of states is also the last part of its entity path in the viewer.
    """

    frame: str
    column: str
    label: str
    std_column: str | None = None


@dataclass(frozen=True, slots=True)
class View:
    """A plot, whose series have the same unit in the schema."""

    name: str
    kind: ViewKind
    series: tuple[ViewSeries, ...]
    threshold: str | None = None
    """The setting that is drawn as a constant line."""
    clips_outliers: bool = False
    """Whether a few estimates may be off by orders of magnitude: the axis then shows the bulk."""

    @property
    def unit(self) -> str:
        """Unit of all its series (1 for states)."""
        first = self.series[0]
        declared = find_frame_declaration(first.frame).column(first.column)
        return "1" if declared is None else declared.unit

    @property
    def title(self) -> str:
        """Name, with the unit if there is one."""
        return self.name if self.unit == "1" else f"{self.name} ({self.unit})"


class MethodLayout(Enum):
    """Layout of several methods in a tab: overlaid, or side by side."""

    ONE = "one of them, as an example for all"
    ROWS = "a row for each method, all with the same axis"


@dataclass(frozen=True, slots=True)
class Tab:
    """A tab: its views from top to bottom, and the texts beside them.

    Attributes:
        name: name of the tab.
        views: views from top to bottom.
        texts: texts to the left of the views.
        events: whether it lists the findings as events in time.
        context: views that only give context.
        methods: layout of the methods' estimates.
        pictures: names of pictures below the views.
    """

    name: str
    views: tuple[View, ...] = ()
    texts: tuple[str, ...] = ()
    events: bool = False
    context: tuple[View, ...] = ()
    methods: MethodLayout = MethodLayout.ONE
    pictures: tuple[str, ...] = ()


def make_line_view(
    view_name: str, frame_name: str, threshold: str | None = None, /, **label_by_column: str
) -> View:
    """Make a view of columns as labelled lines; `threshold` is a setting drawn as a limit."""
    drawn = tuple(
        ViewSeries(frame_name, column, label) for column, label in label_by_column.items()
    )
    return View(view_name, ViewKind.LINES, drawn, threshold)


def make_line_view_without_outliers(
    view_name: str, frame_name: str, column: str, line_label: str = ""
) -> View:
    """Make a view of a column as a line, on an axis that excludes outliers."""
    return View(
        view_name,
        ViewKind.LINES,
        (ViewSeries(frame_name, column, line_label),),
        clips_outliers=True,
    )


def make_band_view(
    view_name: str, frame_name: str, column: str, std_column: str, line_label: str = ""
) -> View:
    """Make a view of a column with a band of its standard deviation."""
    return View(
        view_name,
        ViewKind.BANDS,
        (ViewSeries(frame_name, column, line_label, std_column),),
        clips_outliers=True,
    )


def make_state_lanes_view(view_name: str, *series: tuple[str, str, str]) -> View:
    """Make a view of states as lanes, from frame, column and label of each."""
    return View(view_name, ViewKind.STATES, tuple(ViewSeries(*each) for each in series))
