"""Draw pictures of a run for reports: one page of everything, or a figure for one question."""

from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.model.run_record import Run
from estimators.errors import OutputError, suggest_choice
from recordings.plots.convergence_plot import draw_convergence_of_estimates
from recordings.plots.force_acceleration_plot import draw_force_acceleration
from recordings.plots.plot_limits import LIMITS
from recordings.plots.time_panels import (
    compute_relative_panel_height,
    draw_time_fractions_of_gate_reasons,
    draw_views_over_time,
)
from recordings.report import colours
from recordings.report.picture import require_writable_picture, write_picture
from recordings.rrd.display_frames import list_displayed_columns, make_display_frames
from recordings.rrd.recording_table import PAGE, TABS
from recordings.rrd.recording_texts import format_answer_summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure


def plot_run(
    run: Run,
    path: str | Path,
    *,
    figure_name: str = "page",
    at_s: float | None = None,
    overwrites: bool = False,
) -> Path:
    """Draw a run: one page of everything, or the figure of one question.

    If the run has a calibration, its line, equation (19) of the paper, and the residuals are drawn
    at the bottom of the page.

    Args:
        run: run, or part of one.
        path: picture to write; the suffix sets the format: .png, .pdf or .svg.
        figure_name: one of `FIGURES`.
        at_s: a moment to mark, in seconds since the start.
        overwrites: whether to replace an existing file.

    Returns:
        The path of the picture.

    Raises:
        OutputError: suffix or figure is unknown, or the file exists or cannot be written.
    """
    path = Path(path)
    require_writable_picture(path, overwrites=overwrites)
    if figure_name not in FIGURES:
        raise OutputError(
            f"{path}: no figure '{figure_name}'; {suggest_choice(figure_name, FIGURES)}"
        )
    return write_picture(FIGURES[figure_name](run, at_s), path, overwrites=overwrites)


def draw_run_overview(run: Run, at_s: float | None = None) -> "Figure":
    """Draw the page of `plot_run` without writing it."""
    from matplotlib.figure import Figure

    lines = [
        part
        for line in format_answer_summary(run).splitlines()
        for part in wrap(line, LIMITS.line_characters) or [""]
    ]
    shown = make_display_frames(run, decimate=False)
    views = [(view, drawn) for view in PAGE if (drawn := list_displayed_columns(view, run, shown))]
    points = run.frames.get("calibration", pl.DataFrame())
    panels = sum(compute_relative_panel_height(view, drawn) for view, drawn in views)
    heights = [
        LIMITS.line_height_in * (len(lines) + 2),
        LIMITS.panel_height_in * max(panels, 1.0),
        2.5 * LIMITS.panel_height_in,
    ]
    kept = heights if points.height else heights[:2]
    figure = Figure(figsize=(LIMITS.page_width_in, sum(kept)), layout="constrained")
    parts = figure.subfigures(len(kept), 1, height_ratios=kept, squeeze=False)[:, 0]
    _draw_answer_lines(parts[0], lines)
    draw_views_over_time(parts[1], [view for view, _ in views], run, shown, at_s)
    if points.height:
        _draw_calibration_of_method(parts[2], points)
    return figure


def _draw_answer_lines(subfigure: "SubFigure", lines: list[str]) -> None:
    subfigure.suptitle(lines[0], x=0.01, ha="left", fontweight="bold", parse_math=False)
    axes = subfigure.subplots()
    axes.axis("off")
    text = "\n".join(lines[1:])
    axes.text(0, 1, text, va="top", fontsize=8, family="monospace", parse_math=False)


def _draw_gate_figure(run: Run, at_s: float | None) -> "Figure":
    """Draw the gate's statistics and reasons over time, and the fraction of time of each reason."""
    from matplotlib.figure import Figure

    views = next(tab for tab in TABS if tab.name == "Gate").views
    figure = Figure(
        figsize=(LIMITS.page_width_in, LIMITS.panel_height_in * (len(views) + 1)),
        layout="constrained",
    )
    parts = figure.subfigures(2, 1, height_ratios=[len(views), 1.2], squeeze=False)
    over, below = parts[:, 0]
    draw_views_over_time(over, views, run, make_display_frames(run, decimate=False), at_s)
    draw_time_fractions_of_gate_reasons(below.subplots(), run)
    return figure


def _draw_loads_figure(run: Run, at_s: float | None) -> "Figure":
    """Draw masses and payloads of the loads, cycles, and the speed."""
    from matplotlib.figure import Figure

    wanted = [view for tab in TABS if tab.name in ("Loads", "Cycles") for view in tab.views]
    views = list(dict.fromkeys(wanted))
    figure = Figure(
        figsize=(LIMITS.page_width_in, 1.3 * LIMITS.panel_height_in * len(views)),
        layout="constrained",
    )
    shown = make_display_frames(run, decimate=False)
    (part,) = figure.subfigures(1, 1, squeeze=False)[0]
    draw_views_over_time(part, views, run, shown, at_s)
    return figure


def _draw_force_acceleration_figure(run: Run, at_s: float | None) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(
        figsize=(LIMITS.page_width_in, 0.6 * LIMITS.page_width_in), layout="constrained"
    )
    draw_force_acceleration(figure.subplots(), run, at_s)
    return figure


def _draw_convergence_figure(run: Run, at_s: float | None) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(
        figsize=(LIMITS.page_width_in, 0.5 * LIMITS.page_width_in), layout="constrained"
    )
    draw_convergence_of_estimates(figure.subplots(), run, at_s)
    return figure


#: Function that draws the figure of a question, by the figure's name.
FIGURES: Final[Mapping[str, Callable[[Run, float | None], "Figure"]]] = {
    "page": draw_run_overview,
    "force-acceleration": _draw_force_acceleration_figure,
    "convergence": _draw_convergence_figure,
    "gate": _draw_gate_figure,
    "loads": _draw_loads_figure,
}


def _draw_calibration_of_method(subfigure: "SubFigure", calibration_points: pl.DataFrame) -> None:
    """Draw the points and the line of a method, and the residual of each load."""
    fits, errors = subfigure.subplots(1, 2)
    reference = calibration_points["reference_kg"]
    fits.axline((reference[0], reference[0]), slope=1, color="black", lw=0.5, ls=":")
    for (method,), group in calibration_points.group_by("method", maintain_order=True):
        name, colour = str(method), colours.choose_method_colour(str(method))
        estimate, known = group["estimate_kg"].to_numpy(), group["reference_kg"].to_numpy()
        std = group["estimate_std_kg"].fill_null(float("nan")).to_numpy()
        fits.errorbar(estimate, known, xerr=std, fmt="o", ms=3, color=colour, label=name)
        alpha, beta = group["alpha_1"][0], group["beta_kg"][0]
        if alpha is not None and beta is not None:
            fits.plot(estimate, alpha * estimate + beta, color=colour, lw=0.8)
        errors.plot(known, group["error_kg"].to_numpy(), "o-", ms=3, color=colour, label=name)
        left_out = group["error_left_out_kg"].to_numpy()
        errors.plot(known, left_out, "x", ms=4, color=colour)
    fits.set(xlabel="estimate (kg)", ylabel="reference (kg)", title="Calibration")
    errors.set(
        xlabel="reference (kg)",
        ylabel="calibrated − reference (kg)",
        title="Residuals (×: without that load in the fit)",
    )
    errors.axhline(0, color="black", lw=0.5)
    fits.legend(fontsize=7)
