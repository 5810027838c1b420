"""Draw figures of a report as SVG shapes, byte for byte reproducible."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from recordings.report.report_limits import LIMITS

#: Width of a drawing in its units; on a phone, a unit is a pixel.
WIDTH: Final = 360
"""Width of a letter."""


@dataclass(frozen=True, slots=True)
class Shape:
    """An SVG element: its look, tag, attributes and text, which the template escapes."""

    look: str
    tag: str
    attributes: dict[str, str]
    text: str = ""


@dataclass(slots=True)
class Drawing:
    """A figure as a list of shapes.

    Attributes:
        name: name used in ids.
        title: short title.
        description: description for readers who cannot see it.
        height: height of the drawing; the width is `WIDTH`.
        shapes: shapes in drawing order.
    """

    name: str
    title: str
    description: str
    height: int
    shapes: list[Shape] = field(default_factory=list)

    @property
    def shape_groups_by_look(self) -> list[tuple[dict[str, str], list[Shape]]]:
        """Consecutive shapes with the same look, together with its attributes."""
        runs = groupby(self.shapes, key=lambda shape: shape.look)
        return [({"class": look, **_LOOKS[look]}, list(shapes)) for look, shapes in runs]

    def draw_line(self, x0: float, y0: float, x1: float, y1: float, style: str) -> None:
        """Draw a straight line."""
        at = {
            "x1": _format_svg_coordinate(x0),
            "y1": _format_svg_coordinate(y0),
            "x2": _format_svg_coordinate(x1),
            "y2": _format_svg_coordinate(y1),
        }
        self.shapes.append(Shape(style, "line", at))

    def draw_polylines(
        self, polylines: Sequence[Sequence[tuple[float, float]]], style: str
    ) -> None:
        """Draw polylines as one element."""
        d = "".join(
            "M"
            + "L".join(
                f"{_format_svg_coordinate(x)} {_format_svg_coordinate(y)}" for x, y in corners
            )
            for corners in polylines
        )
        self.shapes.append(Shape(style, "path", {"d": d, "fill": "none"}))

    def fill_polygon(self, corners: Sequence[tuple[float, float]], style: str) -> None:
        """Fill a polygon."""
        points = " ".join(
            f"{_format_svg_coordinate(x)},{_format_svg_coordinate(y)}" for x, y in corners
        )
        self.shapes.append(Shape(style, "polygon", {"points": points}))

    def draw_dot(self, x: float, y: float, style: str, tooltip: str) -> None:
        """Draw a point with a tooltip."""
        at = {"cx": _format_svg_coordinate(x), "cy": _format_svg_coordinate(y), "r": "3.2"}
        self.shapes.append(Shape(style, "circle", at, tooltip))

    def fill_bar(self, x: float, y: float, width: float, height: float, style: str) -> None:
        """Fill a rectangle."""
        at = {
            "x": _format_svg_coordinate(x),
            "y": _format_svg_coordinate(y),
            "width": _format_svg_coordinate(width),
            "height": _format_svg_coordinate(height),
        }
        self.shapes.append(Shape(style, "rect", at))

    def draw_text(self, x: float, y: float, text: str, anchor: str = "middle") -> None:
        """Draw a text."""
        at = {"x": _format_svg_coordinate(x), "y": _format_svg_coordinate(y), "text-anchor": anchor}
        self.shapes.append(Shape("ink", "text", at, text))


#: Attributes of each look without a style sheet, as on paper; in dark mode, the report's differ.
_LOOKS: Final = {
    "ink": {"fill": "#1d2733", "font-size": "11", "font-family": "sans-serif"},
    "axis": {"stroke": "#5b6673", "stroke-width": "1"},
    "grid": {"stroke": "#d5dae0", "stroke-width": "0.6"},
    "ideal": {"stroke": "#5b6673", "stroke-width": "1", "stroke-dasharray": "4 3"},
    "band": {"fill": "#9cc4e4", "fill-opacity": "0.55", "stroke": "none"},
    "point": {"fill": "#0b5c94", "stroke": "#0b5c94"},
    "left": {"fill": "none", "stroke": "#a3480b", "stroke-width": "1.4"},
    "rejected": {"fill": "none", "stroke": "#5b6673", "stroke-width": "1.2"},
    "bar": {"fill": "#0b5c94"},
}


class DrawingPoint(NamedTuple):
    """Position in a drawing, in its units."""

    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Axes:
    """Axes of a plot, which map numbers to positions in the drawing."""

    x: tuple[float, float]
    y: tuple[float, float]
    box: tuple[float, float, float, float]

    @classmethod
    def from_data(
        cls,
        x: Sequence[float],
        y: Sequence[float],
        drawing_box: tuple[float, float, float, float],
        margin_fraction: float = 0.06,
    ) -> "Axes":
        """Make axes with ranges that contain all values, plus a margin."""
        return cls(
            compute_range_with_margin(x, margin_fraction),
            compute_range_with_margin(y, margin_fraction),
            drawing_box,
        )

    def convert_to_drawing_units(self, x: float, y: float) -> DrawingPoint:
        """Convert a point (x, y) to its position in the drawing."""
        left, top, right, bottom = self.box
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return DrawingPoint(left + across * (right - left), bottom - up * (bottom - top))

    def draw_grid_and_labels(
        self,
        drawing: Drawing,
        x_label: str,
        y_label: str,
        x_ticks: Sequence[tuple[float, str]] | None = None,
    ) -> None:
        """Draw grid, tick labels and axis labels; `x_ticks` replaces round numbers."""
        left, top, right, bottom = self.box
        for value, text in choose_round_axis_ticks(*self.x) if x_ticks is None else x_ticks:
            x, _ = self.convert_to_drawing_units(value, self.y[0])
            drawing.draw_line(x, top, x, bottom, "grid")
            drawing.draw_text(x, bottom + 14, text)
        for value, text in choose_round_axis_ticks(*self.y):
            _, y = self.convert_to_drawing_units(self.x[0], value)
            drawing.draw_line(left, y, right, y, "grid")
            drawing.draw_text(left - 4, y + 4, text, "end")
        drawing.draw_line(left, bottom, right, bottom, "axis")
        drawing.draw_line(left, top, left, bottom, "axis")
        drawing.draw_text((left + right) / 2, bottom + 29, x_label)
        drawing.draw_text(2, top - 8, y_label, "start")


def choose_round_axis_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Choose about five round numbers in a range, with labels of equal precision."""
    raw = (high - low) / LIMITS.ticks
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= raw * 0.999))
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return [(k * step, f"{k * step + 0.0:,.{digits}f}") for k in range(first, last + 1)]


def shorten_text_to_width(text: str, width: float) -> str:
    """Cut a text to a width in drawing units."""
    most = max(int(width / LIMITS.character_width), 4)
    return text if len(text) <= most else f"{text[: most - 1]}…"


class AxisRange(NamedTuple):
    """Range of an axis."""

    low: float
    high: float


def compute_range_with_margin(values: Sequence[float], margin_fraction: float) -> AxisRange:
    """Compute the range of values with a margin on both sides."""
    low, high = min(values), max(values)
    room = (high - low) * margin_fraction or max(abs(high) * 0.01, 1.0)
    return AxisRange(low - room, high + room)


def _format_svg_coordinate(value: float) -> str:
    """Format a coordinate to a tenth of a unit, beyond the resolution of printers."""
    return f"{value:.1f}".removesuffix(".0")
