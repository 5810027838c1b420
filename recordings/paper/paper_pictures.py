"""Draw the pictures of Figures 2 to 8, in the colours of the other plots."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import polars as pl

from analysis.paper.paper_limits import LIMITS as PAPER_LIMITS
from recordings.paper.paper_wording import NAMES
from recordings.report import colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a picture and height of a panel in inches, and dots per inch.
_WIDTH_IN: Final = 8.0
_PANEL_IN: Final = 1.6
_DPI: Final = 110
_MOTION: Final = {
    "force_x_N": "force $f_x$ (kN)",
    "regressor_acc_x_m_s2": "acceleration (m/s²)",
    "speed_x_m_s": "speed (m/s)",
}


class FigurePicture(NamedTuple):
    """Picture of a figure: its height, and the function that draws its frame."""

    height_in: float
    paint: Callable[["Figure", pl.DataFrame], None]


def draw_paper_figure(figure_picture: FigurePicture, frame: pl.DataFrame, path: Path) -> None:
    """Draw the frame of an item as PNG.

    Args:
        figure_picture: height and drawing function.
        frame: frame of the item.
        path: file to write.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH_IN, figure_picture.height_in), layout="constrained")
    figure_picture.paint(figure, frame)
    figure.savefig(path, dpi=_DPI, format="png")


def _draw_figure_2_excitation(figure: "Figure", series: pl.DataFrame) -> None:
    _draw_panel_per_column(figure, series, _MOTION)


def _draw_figure_3_convergence(figure: "Figure", series: pl.DataFrame) -> None:
    draw_estimates_over_time(
        figure,
        series,
        ("mass_kg", "mass_std_kg", "true_mass_kg", "mass (kg)"),
        ("friction_x_N_s_m", "friction_x_std_N_s_m", "true_friction_x_N_s_m", "friction (N·s/m)"),
    )


def _draw_figure_4_spin(figure: "Figure", series: pl.DataFrame) -> None:
    draw_estimates_over_time(
        figure,
        series,
        ("inertia_z_kg_m2", "inertia_z_std_kg_m2", "true_inertia_z_kg_m2", "inertia (kg·m²)"),
        ("friction_z_N_m_s", "friction_z_std_N_m_s", "true_friction_z_N_m_s", "friction (N·m·s)"),
    )


def _draw_figure_5_gate(figure: "Figure", series: pl.DataFrame) -> None:
    rows = _draw_panel_per_column(figure, series, {**_MOTION, "mi_x_nat": "index (11) (nat)"})
    for axes in rows:
        shade_times_of_phases(axes, series, "phase", ("accelerating", "braking"))
    rows[-1].axhline(PAPER_LIMITS.fixed_threshold_nat, color="black", lw=0.6, ls=":")
    rows[0].legend(fontsize=7, loc="upper right")


def _draw_panel_per_column(
    figure: "Figure", series: pl.DataFrame, panels: dict[str, str]
) -> list["Axes"]:
    """Draw a panel per column, one above the other, and return their axes."""
    rows = list(figure.subplots(len(panels), 1, sharex=True))
    t_s = series["t_s"].to_numpy()
    for number, (axes, (column, label)) in enumerate(zip(rows, panels.items(), strict=True)):
        scale = 1e-3 if column.endswith("_N") else 1.0
        values = series[column].fill_null(float("nan")).to_numpy() * scale
        axes.plot(t_s, values, color=colours.choose_line_colour(number), lw=1.0)
        _label_panel_in_corner(axes, label)
    rows[-1].set_xlabel("time (s)", fontsize=8)
    return rows


def draw_estimates_over_time(
    figure: "Figure", series: pl.DataFrame, *panels: tuple[str, str, str, str]
) -> None:
    """Draw estimates over time with bands of one standard deviation, and the truth."""
    rows = figure.subplots(len(panels), 1, sharex=True)
    for axes, (column, std_column, true, label) in zip(rows, panels, strict=True):
        for (method,), part in series.group_by("method", maintain_order=True):
            t_s, value, std = (part[c].to_numpy() for c in ("t_s", column, std_column))
            colour = colours.choose_method_colour(str(method))
            axes.plot(t_s, value, color=colour, lw=1.0, label=NAMES[str(method)])
            axes.fill_between(t_s, value - std, value + std, color=colour, alpha=0.15, lw=0)
        axes.axhline(series[true][0], color="black", lw=0.7, ls=":", label="truth")
        _label_panel_in_corner(axes, label)
    rows[0].legend(fontsize=7, ncols=5, loc="lower right")
    rows[-1].set_xlabel("time (s)", fontsize=8)


def _draw_figure_6_raw_masses(figure: "Figure", table: pl.DataFrame) -> None:
    draw_mean_masses_by_method(
        figure, table, "estimate_kg", "estimate_std_kg", "estimate before calibration (kg)"
    )


def _draw_figure_7_calibrated_masses(figure: "Figure", table: pl.DataFrame) -> None:
    draw_mean_masses_by_method(
        figure, table, "calibrated_kg", "calibrated_std_kg", "mass after (19) (kg)"
    )


def draw_mean_masses_by_method(
    figure: "Figure", load_table: pl.DataFrame, mean_column: str, std_column: str, axis_label: str
) -> None:
    """Draw a panel per method: means of nine runs ± the deviation of one run, and the truth."""
    methods = list(load_table["method"].unique(maintain_order=True))
    panels = figure.subplots(1, len(methods), sharex=True, sharey=True)
    truth = load_table["reference_kg"]
    ends = np.array([truth.min(), truth.max()], float)
    for axes, method in zip(panels, methods, strict=True):
        part = load_table.filter(pl.col("method") == method)
        axes.plot(ends, ends, color="black", lw=0.6, ls=":", label="truth")
        axes.errorbar(
            part["reference_kg"].to_numpy(),
            part[mean_column].to_numpy(),
            yerr=part[std_column].to_numpy(),
            fmt="o",
            ms=3,
            lw=1.0,
            capsize=2,
            color=colours.choose_method_colour(method),
            label="mean ± one run",
        )
        axes.set_title(NAMES[method], fontsize=9)
        _label_panel_in_corner(axes, axis_label if axes is panels[0] else "")
        axes.set_xticks([3614, 3714, 3814])
        if "paper_implied_kg" in part.columns:
            implied = part["paper_implied_kg"].fill_null(float("nan")).to_numpy()
            axes.plot(part["reference_kg"].to_numpy(), implied, color="black", lw=0.8, ls="--",
                      label="implied by Table 2")  # fmt: skip
    figure.supxlabel("true mass (kg)", fontsize=8)
    panels[0].legend(fontsize=6, loc="best")


def _draw_figure_8_errors_by_load(figure: "Figure", table: pl.DataFrame) -> None:
    axes = figure.subplots()
    methods = list(table["method"].unique(maintain_order=True))
    loads = table["load_kg"].unique(maintain_order=True).sort().to_numpy()
    width = 0.8 / (2 * len(methods))
    for number, method in enumerate(methods):
        part = table.filter(pl.col("method") == method).sort("load_kg")
        for half, (column, hatch) in enumerate((("rms_kg", ""), ("rms_left_out_kg", "////"))):
            at = np.arange(loads.size) - 0.4 + width * (2 * number + half + 0.5)
            value = part[column].to_numpy()
            low = part[f"{column}_low"].fill_null(float("nan")).to_numpy()
            axes.bar(
                at,
                value,
                width,
                yerr=None if np.isnan(low).any() else value - low,
                color=colours.choose_method_colour(method),
                alpha=1.0 if half == 0 else 0.55,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.3,
                error_kw={"lw": 0.7},
                label=NAMES[method] + ("" if half == 0 else ", left out"),
            )
    axes.set_xticks(np.arange(loads.size), [f"{load:g}" for load in loads])
    axes.set_xlabel("load (kg)", fontsize=8)
    _label_panel_in_corner(axes, "RMS error of a run (kg)")
    # with few campaigns, intervals extend below zero, which an error cannot
    axes.set_ylim(0.0, 1.3 * axes.get_ylim()[1])
    axes.legend(fontsize=7, ncols=len(methods), loc="upper center")


def _label_panel_in_corner(axes: "Axes", panel_label: str) -> None:
    axes.set_ylabel(panel_label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(lw=0.3, alpha=0.6)
    axes.set_axisbelow(True)


def shade_times_of_phases(
    axes: "Axes", series: pl.DataFrame, phase_column: str, phases: tuple[str, ...]
) -> None:
    """Shade the times at which the phase is one of `phases`."""
    state = series[phase_column].cast(pl.String)
    t_s = series["t_s"].to_numpy()
    for name in phases:
        axes.fill_between(
            t_s,
            0,
            1,
            where=(state == name).fill_null(False).to_numpy(),
            transform=axes.get_xaxis_transform(),
            color=colours.STATES[name],
            alpha=0.15,
            lw=0,
            label=name,
        )


FIGURE_2: Final = FigurePicture(3 * _PANEL_IN, _draw_figure_2_excitation)
FIGURE_3: Final = FigurePicture(5.0, _draw_figure_3_convergence)
FIGURE_4: Final = FigurePicture(5.0, _draw_figure_4_spin)
FIGURE_5: Final = FigurePicture(4 * _PANEL_IN, _draw_figure_5_gate)
FIGURE_6: Final = FigurePicture(3.0, _draw_figure_6_raw_masses)
FIGURE_7: Final = FigurePicture(3.0, _draw_figure_7_calibrated_masses)
FIGURE_8: Final = FigurePicture(3.6, _draw_figure_8_errors_by_load)
