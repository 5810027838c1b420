"""One page of a run, for a report or a mail: what was measured, what was accepted, the answer."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import numpy as np
import polars as pl

from analysis.run import Run
from recordings import colours
from recordings.display import (
    LANES,
    Drawn,
    axis_range,
    binned,
    display_frames,
    drawn_of,
    span_ns,
    stands_alone,
)
from recordings.picture import check_picture, write_picture
from recordings.table import PAGE, STATE, View
from recordings.texts import local_time, summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_NS: Final = 1e9
_WIDTH_IN: Final = 10.0
_PANEL_IN: Final = 1.5
_LINE_IN: Final = 0.15
#: What fits on a line of the answer.
_CHARACTERS: Final = 140
#: More points than this are drawn as an envelope, more shaded spans not at all.
_POINTS: Final = 4000
_SPANS: Final = 400


def plot_run(run: Run, path: str | Path, *, force: bool = False) -> Path:
    """Draw a run on one page: forces, motion, index, masses and friction ± std, the answer.

    A run with a calibration gets its fit of (19) and residuals below.

    Args:
        run: the run.
        path: the picture to write; its suffix says the format: .png, .pdf or .svg.
        force: whether to replace a file that is there already.

    Returns:
        The path of the picture.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
    """
    path = Path(path)
    check_picture(path, force=force)
    return write_picture(draw_run(run), path, force=force)


def draw_run(run: Run) -> "Figure":
    """Draw the page of `plot_run` without writing it."""
    from matplotlib.figure import Figure

    lines = [part for line in summary(run).splitlines() for part in wrap(line, _CHARACTERS) or [""]]
    shown = display_frames(run, decimate=False)
    views = [(view, drawn) for view in PAGE if (drawn := drawn_of(view, run, shown))]
    points = run.frames.get("calibration", pl.DataFrame())
    heights = [_LINE_IN * (len(lines) + 2), _PANEL_IN * len(views), 2.5 * _PANEL_IN]
    kept = heights if points.height else heights[:2]
    figure = Figure(figsize=(_WIDTH_IN, sum(kept)), layout="constrained")
    parts = figure.subfigures(len(kept), 1, height_ratios=kept, squeeze=False)[:, 0]
    _write_answer(parts[0], lines)
    _draw_views(parts[1], views, run, shown)
    if points.height:
        _draw_calibration(parts[2], points)
    return figure


def _write_answer(part: "SubFigure", lines: list[str]) -> None:
    part.suptitle(lines[0], x=0.01, ha="left", fontweight="bold", parse_math=False)
    axes = part.subplots()
    axes.axis("off")
    text = "\n".join(lines[1:])
    axes.text(0, 1, text, va="top", fontsize=8, family="monospace", parse_math=False)


def _draw_views(
    part: "SubFigure",
    views: list[tuple[View, tuple[Drawn, ...]]],
    run: Run,
    shown: Mapping[str, pl.DataFrame],
) -> None:
    span = span_ns(run)
    if not views or span is None:
        part.suptitle("nothing in this run can be drawn over time")
        return
    rows = part.subplots(len(views), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (view, drawn) in zip(rows, views, strict=True):
        for each in drawn:
            _draw(axes, each, shown[each.frame], span)
        lane = "gate" if view.threshold else "phase"
        _shade(axes, shown.get(f"{LANES}/{lane}"), colours.SHADED[lane])
        axes.set_ylabel(view.title.replace(" (", "\n("), fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_ylim(axis_range(view, run))
        if len(drawn) > 1:
            # above the panel: inside it would hide the last of the curves
            axes.legend(
                fontsize=6,
                loc="lower right",
                bbox_to_anchor=(1, 1),
                ncols=5,
                frameon=False,
                borderpad=0,
            )
    rows[-1].set_xlim(span[0] / _NS, span[1] / _NS)
    rows[-1].set_xlabel(f"s since {local_time(run.provenance)}", fontsize=8)


def _draw(axes: "Axes", drawn: Drawn, frame: pl.DataFrame, span: tuple[int, int]) -> None:
    value, variance = pl.col(drawn.column), pl.col(drawn.variance or drawn.column)
    if frame.height > _POINTS:
        # bins over the whole span: one without rows stays empty, so that no line crosses a gap
        width_ns = max((span[1] - span[0]) // (_POINTS // 4), 1)
        wanted = [value.mean(), value.min().alias("low"), value.max().alias("high")]
        if drawn.variance:
            wanted.append(variance.mean())
        frame = binned(frame, wanted, span, width_ns)
        if not drawn.variance:
            ends = [frame.select("t_ns", value=pl.col(end)) for end in ("low", "high")]
            frame = pl.concat(ends).sort("t_ns").rename({"value": drawn.column})
    t_s = frame["t_ns"].to_numpy() / _NS
    numbers = frame[drawn.column].cast(pl.Float64).fill_null(float("nan")).to_numpy()
    dots = "." if stands_alone(frame[drawn.column]) else ""
    axes.plot(t_s, numbers, dots + "-", color=drawn.colour, lw=0.8, ms=3, label=drawn.label)
    if drawn.variance:
        std = np.sqrt(frame[drawn.variance].fill_null(float("nan")).to_numpy())
        low, high = numbers - std, numbers + std
        axes.fill_between(t_s, low, high, color=drawn.colour, alpha=0.2, lw=0)


def _shade(axes: "Axes", states: pl.DataFrame | None, wanted: tuple[str, ...]) -> None:
    """Shade where a state holds, full height behind the lines."""
    if states is None or states.height > _SPANS:
        return
    spans = states.with_columns(until=pl.col("t_ns").shift(-1)).drop_nulls()
    for (state,), group in spans.filter(pl.col(STATE).is_in(wanted)).group_by(STATE):
        start_s = group["t_ns"].to_numpy() / _NS
        length_s = (group["until"] - group["t_ns"]).to_numpy() / _NS
        axes.broken_barh(
            list(zip(start_s, length_s, strict=True)),
            (0, 1),
            transform=axes.get_xaxis_transform(),
            color=colours.STATES[str(state)],
            alpha=0.15,
            lw=0,
            zorder=0,
        )


def _draw_calibration(part: "SubFigure", points: pl.DataFrame) -> None:
    """The points and the line of a method, and what is left of each load."""
    fits, errors = part.subplots(1, 2)
    reference = points["reference_kg"]
    fits.axline((reference[0], reference[0]), slope=1, color="black", lw=0.5, ls=":")
    for (method,), group in points.group_by("method", maintain_order=True):
        name, colour = str(method), colours.method(str(method))
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
