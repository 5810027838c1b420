"""The layout of a recording that grows: that of a whole one, as far as rows come on board."""

from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.model.methods import METHODS, Feed
from analysis.model.run_record import Provenance, Run
from analysis.model.settings import Settings
from recordings.rrd.blueprint import Page, laid_out, tab_panels
from recordings.rrd.display_frames import LANES, ROOT, display_frames
from recordings.rrd.recording_table import TABS

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

#: Columns that are written row by row, by frame; squares are variances.
EXCITATION: Final = ("force_x_N", "regressor_acc_x_m_s2", "speed_x_m_s", "speed_rate_x_m_s2")
GATE: Final = ("mi_x_nat", "corr_x_1", "noise_share_x_1", "predicted_std_x")
ESTIMATES: Final = (
    "mass_kg",
    "friction_x_N_s_m",
    "mass_std_kg_squared",
    "friction_x_std_N_s_m_squared",
)
#: Lanes of states: the gate's reason and the phase of motion.
STATES: Final = (f"{LANES}/gate", f"{LANES}/phase")
#: The text beside the first page, which changes with every report.
ANSWER: Final = "answer"
#: Tabs that are of use while a log grows.
_TABS: Final = ("Overview", "Motion", "Gate", "Estimates")
#: Rows of the frames that stand for those to come, and how far apart: a line needs neighbours, a
#: manoeuvre has none.
_ROWS: Final = 3
_APART_NS: Final = 10**9


def growing_layout(settings: Settings) -> tuple[dict[str, float], "Blueprint"]:
    """Lay out what will come.

    Args:
        settings: methods and thresholds.

    Returns:
        The levels of thresholds, by the frame that draws them; and the blueprint.
    """
    run = _rows_to_come(settings)
    shown = display_frames(run)
    pages = [
        Page(tab.name, tab_panels(tab, run, shown), (ANSWER,) if ANSWER in tab.texts else ())
        for tab in TABS
        if tab.name in _TABS
    ]
    levels = {
        name: float(frame["threshold"][0])
        for name, frame in shown.items()
        if name.startswith(f"{ROOT}/threshold/")
    }
    return levels, laid_out(pages, None, grows=True)


def _rows_to_come(settings: Settings) -> Run:
    """A run of a few rows without numbers, which tells the views what they will draw."""
    period_ns = round(1e9 / settings.align.rate_hz)
    frames = {
        "excitation": _empty_rows(EXCITATION, period_ns).with_columns(phase=pl.lit("standstill")),
        "gate": _empty_rows(GATE, period_ns).with_columns(reason_x=pl.lit("accepted")),
    }
    for name in settings.trace.methods:
        alone = METHODS[name].feed is Feed.SEGMENTS
        columns = [each.removesuffix("_squared") for each in ESTIMATES]
        frames[f"estimates/{name}"] = _empty_rows(columns, _APART_NS if alone else period_ns)
    return Run(frames, Provenance(settings=settings))


def _empty_rows(columns: "tuple[str, ...] | list[str]", apart_ns: int) -> pl.DataFrame:
    times = {"t_ns": [row * apart_ns for row in range(_ROWS)]}
    return pl.DataFrame({**times, **{name: [float("nan")] * _ROWS for name in columns}})
