"""Draw a sweep: masses over the varied setting, errors, and the fraction of samples used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from recordings.plots.plot_limits import LIMITS
from recordings.report import colours
from recordings.report.picture import draw_legend_beside_axes, write_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_JOINT: Final = "joint"


@dataclass(frozen=True, slots=True)
class SweptRow:
    """A combination of settings to draw, with its results.

    Attributes:
        over: varied values, by short setting names.
        mass_kg: mass by method; None if withheld.
        mass_std_kg: standard deviation by method.
        payload_kg: payload of the heaviest of several loads, and its standard uncertainty.
        errors: errors by title and method.
        accepted_share_1: fraction of samples used.
        can_weigh: whether the log can weigh.
    """

    over: Mapping[str, Any]
    mass_kg: Mapping[str, float | None]
    mass_std_kg: Mapping[str, float | None]
    payload_kg: tuple[float, float] | None
    errors: Mapping[str, Mapping[str, float | None]] = field(
        default_factory=dict[str, Mapping[str, float | None]]
    )
    accepted_share_1: float = 0.0
    can_weigh: bool = True


def plot_sweep(
    swept_rows: Sequence[SweptRow],
    path: Path,
    *,
    reference_kg: float | None = None,
    overwrites: bool = False,
) -> Path:
    """Plot a sweep over one numeric setting, or over labelled combinations.

    Args:
        swept_rows: combinations, at least one.
        path: picture to write; the suffix sets the format.
        reference_kg: the true mass, if known.
        overwrites: whether to replace an existing file.

    Raises:
        OutputError: the picture cannot be written.
    """
    return write_picture(draw_sweep_figure(swept_rows, reference_kg), path, overwrites=overwrites)


def draw_sweep_figure(
    swept_rows: Sequence[SweptRow], reference_kg: float | None = None
) -> "Figure":
    """Draw the figure of `plot_sweep` without writing it."""
    from matplotlib.figure import Figure

    titles = list(dict.fromkeys(title for row in swept_rows for title in row.errors))
    loads = any(row.payload_kg is not None for row in swept_rows)
    count = 2 + len(titles) + loads
    figure = Figure(
        figsize=(LIMITS.sweep_width_in, LIMITS.sweep_panel_height_in * count + 0.6),
        layout="constrained",
    )
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    at = place_combinations_on_axis(swept_rows, panels[-1])
    for axes in panels:
        axes.grid(alpha=0.25, lw=0.5)
    mass = panels.pop(0)
    _draw_swept_masses(mass, swept_rows, at)
    if reference_kg is not None:
        mass.axhline(reference_kg, color="black", lw=0.8, ls=":", label="reference")
    mass.set_ylabel("mass (kg)")
    draw_legend_beside_axes(mass)
    if loads:
        _draw_swept_payloads(panels.pop(0), swept_rows, at)
    for title in titles:
        axes = panels.pop(0)
        _draw_values_by_method(axes, at, [row.errors.get(title, {}) for row in swept_rows])
        axes.set_ylabel(title)
        draw_legend_beside_axes(axes)
    _draw_fraction_of_samples_used(panels[0], swept_rows, at)
    return figure


def place_combinations_on_axis(swept_rows: Sequence[SweptRow], axes: "Axes") -> NDArray[np.float64]:
    """Choose the position of each combination on the axis, and label the axis."""
    names = list(swept_rows[0].over)
    if len(names) == 1 and all(_is_number(row.over[names[0]]) for row in swept_rows):
        axes.set_xlabel(names[0])
        places = np.array([float(row.over[names[0]]) for row in swept_rows])
        if np.unique(places).size == 1:
            # automatic ticks would be at values that were not tried
            axes.set_xticks(places[:1])
            axes.set_xlim(places[0] - 0.5, places[0] + 0.5)
        return places
    at = np.arange(len(swept_rows), dtype=float)
    axes.set_xlabel(" · ".join(names))
    labels = [
        " · ".join(_format_setting_value(row.over[name]) for name in names) for row in swept_rows
    ]
    axes.set_xticks(
        at, labels, rotation=90 if len(swept_rows) > LIMITS.level_max_names else 0, fontsize=7
    )
    return at


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _format_setting_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _list_methods_in_drawing_order(
    value_by_method_of_each_row: Sequence[Mapping[str, float | None]],
) -> list[str]:
    """List the methods, the paper's first, so that the answer is drawn on top."""
    found = dict.fromkeys(
        method for value_by_method in value_by_method_of_each_row for method in value_by_method
    )
    return sorted(found, key=lambda method: method == _JOINT)


def _choose_line_style_of_method(method: str) -> dict[str, Any]:
    if method == _JOINT:
        return {"color": "black", "lw": 1.8, "zorder": 5}
    return {"color": colours.choose_method_colour(method), "lw": 1.0}


def _make_value_array_of_method(
    value_by_method_of_each_row: Sequence[Mapping[str, float | None]], method: str
) -> NDArray[np.float64]:
    return np.array(
        [
            np.nan if (v := value_by_method.get(method)) is None else v
            for value_by_method in value_by_method_of_each_row
        ]
    )


def _draw_swept_masses(
    axes: "Axes", swept_rows: Sequence[SweptRow], positions: NDArray[np.float64]
) -> None:
    masses, stds = [row.mass_kg for row in swept_rows], [row.mass_std_kg for row in swept_rows]
    methods = _list_methods_in_drawing_order(masses)
    steps = np.diff(np.unique(positions))
    # side by side near their value, since bars at one position would hide each other
    apart = (float(steps.min()) if steps.size else 1.0) * LIMITS.bar_distance_fraction
    paper = [method for method in methods if method != _JOINT]
    half = len(paper) // 2
    answer = [method for method in methods if method == _JOINT]
    places = {method: n - half for n, method in enumerate([*paper[:half], *answer, *paper[half:]])}
    for method in methods:
        values, std = (
            _make_value_array_of_method(masses, method),
            _make_value_array_of_method(stds, method),
        )
        if np.isfinite(values).any():
            shifted = positions + apart * places[method]
            axes.errorbar(
                shifted,
                values,
                yerr=std,
                fmt="o-",
                ms=3,
                label=method,
                **_choose_line_style_of_method(method),
            )
    _label_axes_without_data(axes)


def _label_axes_without_data(axes: "Axes") -> None:
    if not axes.lines:
        axes.text(0.5, 0.5, "no mass", ha="center", transform=axes.transAxes)
        axes.set_yticks([])


def _draw_swept_payloads(
    axes: "Axes", swept_rows: Sequence[SweptRow], positions: NDArray[np.float64]
) -> None:
    pairs = np.array([row.payload_kg or (np.nan, np.nan) for row in swept_rows])
    axes.errorbar(
        positions,
        pairs[:, 0],
        yerr=pairs[:, 1],
        fmt="o-",
        ms=3,
        **_choose_line_style_of_method(_JOINT),
    )
    axes.set_ylabel("largest payload (kg)")


def _draw_values_by_method(
    axes: "Axes",
    x_positions: NDArray[np.float64],
    value_by_method_of_each_row: Sequence[Mapping[str, float | None]],
) -> None:
    for method in _list_methods_in_drawing_order(value_by_method_of_each_row):
        values = _make_value_array_of_method(value_by_method_of_each_row, method)
        if np.isfinite(values).any():
            axes.plot(
                x_positions,
                values,
                "o-",
                ms=3,
                label=method,
                **_choose_line_style_of_method(method),
            )
    _label_axes_without_data(axes)


def _draw_fraction_of_samples_used(
    axes: "Axes", swept_rows: Sequence[SweptRow], positions: NDArray[np.float64]
) -> None:
    share = 100.0 * np.array([row.accepted_share_1 for row in swept_rows])
    axes.plot(positions, share, "o-", ms=3, lw=1.0, color="#2e9e5b", label="used")
    refused = np.array([not row.can_weigh for row in swept_rows])
    if refused.any():
        axes.plot(
            positions[refused],
            share[refused],
            "x",
            ms=8,
            mew=2,
            color="#c0392b",
            label="cannot weigh",
        )
    axes.set_ylim(-5.0, 105.0)
    axes.set_ylabel("samples used (%)")
    draw_legend_beside_axes(axes)
