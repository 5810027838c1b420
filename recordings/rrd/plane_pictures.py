"""Make pictures without a time axis: force against acceleration, a calibration's line and errors.

The viewer plots only over time. So these pictures are drawn in its 2D view: grid, numbers, points
and lines, each under its own path, which can be hidden in the viewer.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import polars as pl

from analysis.model.run_record import Run
from estimators.arrays import Floats
from recordings.report import colours
from recordings.report.force_acceleration import (
    ACCELERATION,
    ACCELERATION_LABEL,
    FORCE,
    select_force_acceleration_data,
)
from recordings.report.svg_shapes import Axes, choose_round_axis_ticks
from recordings.rrd.recording_limits import LIMITS

if TYPE_CHECKING:
    from rerun import RecordingStream

_GRID: Final = "#59616b"
_INK: Final = "#aab2bb"
_MASS: Final = "#f0f0f0"


@dataclass(frozen=True)
class PlaneSeries:
    """Points or a line, in the units of the axes.

    Attributes:
        label: label in the legend; empty for none.
        colour: colour as #rrggbb.
        x: (n,) horizontal coordinates.
        y: (n,) vertical coordinates.
        joined: whether to draw a line instead of points.
    """

    label: str
    colour: str
    x: Floats
    y: Floats
    joined: bool = False


@dataclass(frozen=True)
class PlanePicture:
    """A picture with two labelled axes and series."""

    title: str
    x_label: str
    y_label: str
    series: tuple[PlaneSeries, ...]


def make_plane_pictures(run: Run) -> dict[str, PlanePicture]:
    """Make the pictures for which this run has data, by name."""
    drawn = {
        "scatter": _make_force_acceleration_picture(run),
        "line": make_calibration_line_picture(run),
        "errors": make_load_errors_picture(run),
    }
    return {name: picture for name, picture in drawn.items() if picture is not None}


def send_plane_picture(
    recording: "RecordingStream", entity_path: str, picture: PlanePicture
) -> None:
    """Send a picture that is visible at all times.

    Args:
        recording: stream of the recording.
        entity_path: parent entity.
        picture: the picture.
    """
    import rerun as rr

    x, y = (np.concatenate([getattr(each, axis) for each in picture.series]) for axis in "xy")
    axes = Axes.from_data(x.tolist(), y.tolist(), LIMITS.plane_box)
    dot, width, thin = (
        rr.Radius.ui_points(size)
        for size in (LIMITS.dot_radius_pt, LIMITS.line_radius_pt, LIMITS.grid_line_radius_pt)
    )
    grid = [
        [axes.convert_to_drawing_units(a, b), axes.convert_to_drawing_units(c, d)]
        for a, b, c, d in _iter_grid_line_ends(axes)
    ]
    ink = colours.pack_colour_as_rgba(_GRID)
    frame = rr.LineStrips2D(grid, colors=ink, radii=thin, draw_order=0.0)
    recording.log(f"{entity_path}/grid", frame, static=True)
    places, texts, inks = zip(*iter_axis_labels(axes, picture), strict=True)
    written = rr.Points2D(places, labels=texts, colors=inks, radii=0.0, show_labels=True)
    recording.log(f"{entity_path}/text", written, static=True)
    for number, each in enumerate(picture.series):
        corners = [axes.convert_to_drawing_units(a, b) for a, b in zip(each.x, each.y, strict=True)]
        ink, order = colours.pack_colour_as_rgba(each.colour), 10.0 + number
        shape = (
            rr.LineStrips2D([corners], colors=ink, radii=width, draw_order=order)
            if each.joined
            else rr.Points2D(corners, colors=ink, radii=dot, draw_order=order)
        )
        recording.log(f"{entity_path}/series/{number}", shape, static=True)


class _LineEnds(NamedTuple):
    """Ends of a line, in the units of the axes."""

    x0: float
    y0: float
    x1: float
    y1: float


def _iter_grid_line_ends(axes: Axes) -> Iterator[_LineEnds]:
    """Yield the ends of each grid line, in the units of the axes."""
    for value, _ in choose_round_axis_ticks(*axes.x):
        yield _LineEnds(value, axes.y[0], value, axes.y[1])
    for value, _ in choose_round_axis_ticks(*axes.y):
        yield _LineEnds(axes.x[0], value, axes.x[1], value)


def iter_axis_labels(
    axes: Axes, picture: PlanePicture
) -> Iterator[tuple[tuple[float, float], str, int]]:
    """Yield position, text and colour of numbers, labels and legend."""
    left, top, right, bottom = LIMITS.plane_box
    ink = colours.pack_colour_as_rgba(_INK)
    for value, text in choose_round_axis_ticks(*axes.x):
        yield (
            (
                axes.convert_to_drawing_units(value, axes.y[0])[0],
                bottom + LIMITS.plane_numbers_distance - LIMITS.plane_text_drop,
            ),
            text,
            ink,
        )
    for value, text in choose_round_axis_ticks(*axes.y):
        yield (
            (
                left - 3.0 * LIMITS.plane_numbers_distance,
                axes.convert_to_drawing_units(axes.x[0], value)[1] - LIMITS.plane_text_drop,
            ),
            text,
            ink,
        )
    yield (
        ((left + right) / 2.0, bottom + LIMITS.plane_labels_distance - LIMITS.plane_text_drop),
        picture.x_label,
        ink,
    )
    yield (
        (left + LIMITS.plane_labels_distance, top - LIMITS.plane_labels_distance),
        picture.y_label,
        ink,
    )
    named = [each for each in picture.series if each.label]
    for line, each in enumerate(named):
        place = (right + LIMITS.plane_legend_distance, top + LIMITS.plane_legend_line * line)
        yield place, each.label, colours.pack_colour_as_rgba(each.colour)


def _make_force_acceleration_picture(run: Run) -> PlanePicture | None:
    found = select_force_acceleration_data(run)
    if found is None:
        return None
    series: list[PlaneSeries] = []
    for group in found.groups:
        kept = group.points.gather_every(-(-group.points.height // LIMITS.plane_max_points))
        x, y = kept[ACCELERATION].to_numpy(), kept[FORCE].to_numpy()
        series.append(PlaneSeries(group.label, group.colour, x, y))
    ends = np.array([found.points[ACCELERATION].min(), found.points[ACCELERATION].max()], float)
    series += [
        PlaneSeries(mass.label, _MASS, ends, mass.mass_kg * ends, joined=True)
        for mass in found.masses
    ]
    return PlanePicture(
        "Force against acceleration", ACCELERATION_LABEL, found.force_label, tuple(series)
    )


def make_calibration_line_picture(run: Run) -> PlanePicture | None:
    """Make the picture of a calibration's points and line, by method; None without data."""
    series: list[PlaneSeries] = []
    for name, colour, points in iter_points_of_calibrated_methods(run):
        estimate, reference = points["estimate_kg"].to_numpy(), points["reference_kg"].to_numpy()
        series.append(PlaneSeries(name, colour, estimate, reference - estimate))
        alpha, beta = points["alpha_1"][0], points["beta_kg"][0]
        if alpha is not None and beta is not None:
            ends = np.array([estimate.min(), estimate.max()])
            series.append(PlaneSeries("", colour, ends, (alpha - 1.0) * ends + beta, joined=True))
    if not series:
        return None
    return PlanePicture(
        "Line of the calibration", "estimate (kg)", "reference less estimate (kg)", tuple(series)
    )


def make_load_errors_picture(run: Run) -> PlanePicture | None:
    """Make the picture of each load's residual and leave-one-out error; None without data."""
    series: list[PlaneSeries] = []
    methods = list(iter_points_of_calibrated_methods(run))
    for number, (name, colour, points) in enumerate(methods):
        # methods of a load are side by side
        aside_1 = (number - (len(methods) - 1) / 2.0) * LIMITS.method_distance_fraction
        for column, label, look in (
            ("error_left_out_kg", "", colours.mix_colour_with_white(colour)),
            ("error_kg", name, colour),
        ):
            known = points.drop_nulls(column)
            x, y = known["reference_kg"].to_numpy(), known[column].to_numpy()
            if known.height:
                series.append(PlaneSeries(label, look, x + aside_1 * np.ptp(x), y))
    if not series:
        return None
    ends = np.concatenate([each.x for each in series])
    ends = np.array([ends.min(), ends.max()])
    series += [
        PlaneSeries(label, _INK, ends, np.full(2, level_kg), joined=True)
        for label, level_kg in make_lines_of_error_limits(run)
    ]
    return PlanePicture(
        "Errors of the calibration (paler: with that load excluded from the line)",
        "reference (kg)",
        "calibrated less reference (kg)",
        tuple(series),
    )


class ErrorLimitLine(NamedTuple):
    """Horizontal line in a picture of errors, with its label."""

    label: str
    error_kg: float


def make_lines_of_error_limits(run: Run) -> list[ErrorLimitLine]:
    """Make lines at zero error and, for evidence, at the interval of a later mass."""
    line = run.frames.get("line", pl.DataFrame())
    if line.is_empty():
        return [ErrorLimitLine("", 0.0)]
    interval_kg = float(line["line_u_kg"][0] * line["coverage_k_1"][0])
    later = f"± {interval_kg:.1f} kg, of a later mass"
    return [
        ErrorLimitLine("", 0.0),
        ErrorLimitLine(later, interval_kg),
        ErrorLimitLine("", -interval_kg),
    ]


class MethodPoints(NamedTuple):
    """Calibration points of a method, and how they are drawn."""

    name: str
    colour: str
    points: pl.DataFrame


def iter_points_of_calibrated_methods(run: Run) -> Iterator[MethodPoints]:
    """Yield name, colour and points of each calibrated method; evidence has only one."""
    evidence, line = (run.frames.get(name, pl.DataFrame()) for name in ("points", "line"))
    if evidence.height and line.height:
        points = evidence.rename({"mean_kg": "estimate_kg"}).join(
            line.select("alpha_1", "beta_kg"), how="cross"
        )
        groups = [("a run", colours.choose_line_colour(0), points)]
    else:
        points = run.frames.get("calibration", pl.DataFrame({"method": [], "estimate_kg": []}))
        by_method = points.group_by("method", maintain_order=True)
        groups = [
            (str(name), colours.choose_method_colour(str(name)), group)
            for (name,), group in by_method
        ]
    for name, colour, group in groups:
        estimated = group.drop_nulls("estimate_kg")
        if estimated.height:
            yield MethodPoints(name, colour, estimated)
