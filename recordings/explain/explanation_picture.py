"""Picture of an explanation: force against acceleration, signals, and convergence of the mass."""

from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import numpy as np
import polars as pl

from analysis.explain import Explanation
from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Run
from recordings.explain.explanation_text import answer_and_cause_sentence
from recordings.plots.convergence_plot import draw_convergence
from recordings.plots.force_acceleration_plot import draw_force_acceleration
from recordings.plots.time_panels import draw_over_time
from recordings.report.finding_text import finding_line
from recordings.report.picture import write_picture
from recordings.rrd.display_frames import grid_span_ns, make_display_frames
from recordings.rrd.recording_table import MOMENT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Inches of the picture, characters of a line in it, and findings that have room.
_SIZE_IN: Final = (12.0, 11.0)
_LINE: Final = 165
_FINDINGS: Final = 3
#: What is drawn around the moment, in s either way.
_AROUND_S: Final = 15.0


def plot_explanation(
    run: Run, explanation: Explanation, path: Path, *, force: bool = False
) -> Path:
    """Plot an explanation.

    Args:
        run: explained run.
        explanation: the explanation.
        path: picture to write; the suffix sets the format.
        force: whether to replace an existing file.

    Raises:
        OutputError: the picture cannot be written.
    """
    return write_picture(draw_explanation(run, explanation), path, force=force)


def draw_explanation(run: Run, explanation: Explanation) -> "Figure":
    """Draw the picture of `plot_explanation` without writing it."""
    from matplotlib.figure import Figure

    at_s = explanation.at_s if explanation.at_s is not None else _moment_to_show_s(explanation, run)
    near = run if at_s is None else _cut_run_around(run, at_s)
    lines = wrap(answer_and_cause_sentence(explanation), _LINE)
    for each in (explanation.findings or ())[:_FINDINGS]:
        lines += wrap(f"{each.rank}. {finding_line(each)}", _LINE, subsequent_indent="   ")
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    # inches: text has a height of its own
    heights = [0.2 * len(lines) + 0.15, _SIZE_IN[1]]
    head, body = figure.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    head.text(0.01, 0.95, "\n".join(lines), va="top", fontsize=9, parse_math=False)
    above, below = body.subfigures(2, 1, height_ratios=[1.0, 1.25], squeeze=False)[:, 0]
    left, right = above.subfigures(1, 2, width_ratios=[1.15, 1.0], squeeze=False)[0]
    scatter = left.subplots()
    draw_force_acceleration(scatter, run if explanation.at_s is None else near, explanation.at_s)
    left.suptitle("Force against acceleration", x=0.01, ha="left", fontsize=9)
    settles = right.subplots()
    settling = run if explanation.at_s is None else _restrict_run_to_load_at(run, explanation.at_s)
    draw_convergence(settles, settling, explanation.at_s)
    right.suptitle("How the mass settles", x=0.01, ha="left", fontsize=9)
    if at_s is not None:
        which = "asked for" if explanation.at_s is not None else "which stands out most"
        title = f"The signals around {at_s:,.1f} s, {which}"
        below.suptitle(title, x=0.01, ha="left", fontsize=9)
    draw_over_time(below, MOMENT, near, make_display_frames(near, decimate=False), at_s)
    return figure


def _moment_to_show_s(explanation: Explanation, run: Run) -> float | None:
    """Moment of the first finding that has one, or of the worst manoeuvre.

    None, for the whole run, if the run is not much longer than the drawn stretch.
    """
    span = grid_span_ns(run)
    if span is None or span[1] - span[0] < 4 * _AROUND_S * NS_PER_S:
        return None
    for each in explanation.findings or ():
        if each.start_s is not None and each.end_s is not None:
            return (each.start_s + each.end_s) / 2.0
    if explanation.worst:
        return (explanation.worst[0].start_s + explanation.worst[0].end_s) / 2.0
    return None


def _cut_run_around(run: Run, at_s: float) -> Run:
    """Samples around a moment; frames without samples are kept whole."""
    begin, end = (round((at_s + way * _AROUND_S) * NS_PER_S) for way in (-1, 1))
    frames = {
        name: _rows_between(frame, begin, end) if "t_ns" in frame.columns else frame
        for name, frame in run.frames.items()
    }
    return Run(frames, run.provenance)


def _rows_between(frame: pl.DataFrame, begin: int, end: int) -> pl.DataFrame:
    """Samples of a stretch of a sorted frame, found by binary search."""
    t = frame["t_ns"].to_numpy()
    first, last = np.searchsorted(t, begin, "left"), np.searchsorted(t, end, "right")
    return frame.slice(int(first), int(last - first))


def _restrict_run_to_load_at(run: Run, at_s: float | None) -> Run:
    """Rows of the load at a moment; the whole run if there is none."""
    loads = run.frames.get("loads")
    if at_s is None or loads is None:
        return run
    at = pl.lit(round(at_s * NS_PER_S))
    here = loads.filter(at.is_between(pl.col("start_t_ns"), pl.col("end_t_ns")))
    if not here.height:
        return run
    load_id, begin, end = here.select("load_id", "start_t_ns", "end_t_ns").row(0)
    frames = dict(run.frames)
    frames["loads"] = here
    if "manoeuvres" in frames:
        frames["manoeuvres"] = frames["manoeuvres"].filter(pl.col("load_id") == load_id)
    for name, frame in run.frames.items():
        if name.startswith("estimates/"):
            frames[name] = _rows_between(frame, begin, end)
    return Run(frames, run.provenance)
