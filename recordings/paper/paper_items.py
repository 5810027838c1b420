"""Registry of items: every reproduced table, figure and list of claims, with tables for the page.

`payscope reproduce`, its progress, the page, the CSV files and the pictures iterate over it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

import polars as pl

from analysis.paper import (
    campaign_figures,
    campaign_tables,
    claims,
    excitation_figures,
    printed_numbers,
)
from analysis.paper import table1 as window_table
from analysis.paper.simulated_sources import Extract, RepetitionResults
from recordings.paper import claims_sentences, item_sentences, paper_pictures
from recordings.paper.paper_pictures import FigurePicture
from recordings.paper.paper_wording import NAMES, ItemSentences

#: Values of a row of a frame, by column.
_Row = dict[str, Any]


@dataclass(frozen=True)
class RenderedTable:
    """A table: caption, header, rows, and the number of leading text columns."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    texts: int = 1


def render_table_1_mass_errors(frame: pl.DataFrame) -> list[RenderedTable]:
    """Render tables of errors by window length, absolute and relative to the bound."""
    errors = make_table_beside_printed_numbers(
        frame,
        "window_s",
        "window, s",
        lambda row: format_number_with_interval(row, "rmse_kg"),
        "bound_kg",
    )
    ratios = make_table_of_methods(
        frame, "window_s", "window, s", lambda row: _format_paper_number(row["over_bound_1"], 2)
    )
    trials = frame["trials"].max()
    return [
        RenderedTable(
            f"RMS error of the mass in kg over {trials} windows [95 % interval], next to the "
            "paper's value; bound: Cramér–Rao",
            *errors,
        ),
        RenderedTable("R.m.s. error divided by the Cramér–Rao bound", *ratios),
    ]


def render_table_2_calibration_lines(frame: pl.DataFrame) -> list[RenderedTable]:
    """Render a table of slope and offset by method."""
    of = {(row["chain"], row["method"]): row for row in frame.iter_rows(named=True)}
    methods = frame["method"].unique(maintain_order=True)
    rows: list[list[str]] = []
    for method in methods:
        cells = [NAMES[method]]
        for name, digits in (("alpha_1", 3), ("beta_kg", 1)):
            ideal, front = of["ideal", method], of["front_axle", method]
            cells += [
                _format_paper_number(ideal[f"paper_{name}"], digits),
                format_number_with_interval(ideal, name, digits),
                format_number_with_interval(front, name, digits),
            ]
        rows.append(cells)
    campaigns = frame["trials"].max()
    chains = ("paper", "ideal chain", "assumed chain")
    return [
        RenderedTable(
            f"Slope α and offset β in kg, means over {campaigns} campaigns [95 % interval]",
            ["method", *(f"{of} {by}" for of in "αβ" for by in chains)],
            rows,
        )
    ]


def render_table_3_errors_by_threshold(frame: pl.DataFrame) -> list[RenderedTable]:
    """Render tables of errors by threshold, with and without the run's own load in the fit."""
    return _render_error_tables_by_setting(frame, campaign_tables.THRESHOLD, "threshold, nat")


def render_table_4_errors_by_window(frame: pl.DataFrame) -> list[RenderedTable]:
    """Render tables of errors by window length, with and without the run's own load in the fit."""
    return _render_error_tables_by_setting(frame, campaign_tables.WINDOW, "samples")


def _render_error_tables_by_setting(
    frame: pl.DataFrame, setting: str, title: str
) -> list[RenderedTable]:
    campaigns = frame["trials"].max()
    within = make_table_beside_printed_numbers(
        frame, setting, title, lambda row: format_number_with_interval(row, "run_kg"), "bound_kg"
    )
    without = make_table_of_methods(
        frame, setting, title, lambda row: format_number_with_interval(row, "run_left_out_kg")
    )
    return [
        RenderedTable(
            f"RMS error of a run in kg, every load in the fit: mean over {campaigns} campaigns "
            "[95 % interval], next to the paper's; bound: Cramér–Rao",
            *within,
        ),
        RenderedTable("The same with the run's own load left out of the fit", *without),
    ]


def render_figure_8_errors_by_load(frame: pl.DataFrame) -> list[RenderedTable]:
    """Render a table of errors by load, with and without the load in the fit."""
    header, rows = make_table_of_methods(
        frame,
        "load_kg",
        "load, kg",
        lambda row: (
            f"{_format_paper_number(row['rms_kg'])} / "
            f"{_format_paper_number(row['rms_left_out_kg'])}"
        ),
    )
    return [RenderedTable("RMS error in kg: load in the fit / left out", header, rows)]


def render_claims_table(frame: pl.DataFrame) -> list[RenderedTable]:
    """Render a table with a row per finding."""
    rows = [
        [
            row["claim"],
            row["case"],
            row["paper"],
            format_number_with_interval(row, "found_kg", 2),
            f"{row['of_mass_percent']:.2f} %",
            f"{row['of_load_range_percent']:.1f} %",
            "–" if row["smaller_percent"] is None else f"{row['smaller_percent']:.1f} %",
        ]
        for row in frame.iter_rows(named=True)
    ]
    header = ["claim", "case", "paper", "found, kg [95 %]"]
    header += ["of the machine's mass", "of the payload range", "smaller"]
    return [RenderedTable("Each claim as we find it", header, rows, texts=3)]


class TableCells(NamedTuple):
    """Column heads of a table, and its rows."""

    heads: list[str]
    rows: list[list[str]]


def make_table_of_methods(
    frame: pl.DataFrame, key_column: str, title: str, format_cell: Callable[[_Row], str]
) -> TableCells:
    """Make header and rows: a row per value of `key_column`, and a column per method."""
    methods = list(frame["method"].unique(maintain_order=True))
    rows = [
        [_format_table_parameter(at), *(format_cell(by[m]) if m in by else "–" for m in methods)]
        for at, by in _group_rows_by_key_and_method(frame, key_column)
    ]
    return TableCells([title, *(NAMES[m] for m in methods)], rows)


def make_table_beside_printed_numbers(
    frame: pl.DataFrame,
    key_column: str,
    title: str,
    format_cell: Callable[[_Row], str],
    bound_column: str,
) -> TableCells:
    """Make header and rows: the bound, then each method's number followed by the paper's."""
    methods = list(frame["method"].unique(maintain_order=True))
    header = [title, "bound"]
    for method in methods:
        header += [NAMES[method], *(["paper"] if method in printed_numbers.METHODS else [])]
    rows: list[list[str]] = []
    for at, by in _group_rows_by_key_and_method(frame, key_column):
        cells = [
            _format_table_parameter(at),
            _format_paper_number(next(iter(by.values()))[bound_column]),
        ]
        for method in methods:
            cells.append(format_cell(by[method]))
            if method in printed_numbers.METHODS:
                cells.append(_format_paper_number(by[method]["paper_kg"], 2))
        rows.append(cells)
    return TableCells(header, rows)


def _group_rows_by_key_and_method(
    frame: pl.DataFrame, key_column: str
) -> list[tuple[float, dict[str, _Row]]]:
    groups: dict[float, dict[str, _Row]] = {}
    for row in frame.iter_rows(named=True):
        groups.setdefault(row[key_column], {})[row["method"]] = row
    return list(groups.items())


def _format_table_parameter(value: float) -> str:
    return f"{value:g}"


def _format_paper_number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:,.{digits}f}"


def format_number_with_interval(number_row: _Row, quantity: str, digits: int = 1) -> str:
    """Format a number with its interval, if there is one."""
    value, low, high = (number_row[quantity + end] for end in ("", "_low", "_high"))
    text = _format_paper_number(value, digits)
    if low is None or high is None:
        return text
    return f"{text} [{_format_paper_number(low, digits)}, {_format_paper_number(high, digits)}]"


class ItemNumbers(Protocol):
    """Interface of an item's numbers, which include a frame with all of them."""

    @property
    def frame(self) -> pl.DataFrame:
        """Frame of all numbers, a column per quantity, with units in the names."""
        ...


N = TypeVar("N", bound=ItemNumbers)


def _make_one_row_frame(numbers: ItemNumbers) -> pl.DataFrame:
    return numbers.frame


def _render_no_tables(_frame: pl.DataFrame) -> list[RenderedTable]:
    return []


@dataclass(frozen=True, eq=False)
class Item(Generic[N]):
    """A table, figure or list of claims of the paper.

    Attributes:
        name: name on the command line.
        title: title of the item.
        needs: extracts of simulations that it needs.
        numbers: function that computes its numbers from the extracts.
        make_sentences: function that makes its sentences from the numbers.
        frame: function that makes the frame of the CSV file, with keys as text.
        tables: function that makes the tables of the page.
        picture: height of its picture and the function that draws it; None without a picture.
    """

    name: str
    title: str
    needs: tuple[Extract[Any, Any], ...]
    numbers: Callable[[RepetitionResults], N]
    make_sentences: Callable[[N], ItemSentences]
    frame: Callable[[N], pl.DataFrame] = _make_one_row_frame
    tables: Callable[[pl.DataFrame], list[RenderedTable]] = _render_no_tables
    picture: FigurePicture | None = None


@dataclass(frozen=True, eq=False)
class ItemResult:
    """An item with its numbers and sentences."""

    item: Item[Any]
    frame: pl.DataFrame
    sentences: ItemSentences


def compute_paper_item(item: Item[N], extracts: RepetitionResults) -> ItemResult:
    """Compute an item from the extracts that it needs."""
    numbers = item.numbers(extracts)
    return ItemResult(item, item.frame(numbers), item.make_sentences(numbers))


def _make_getter_of_single_extract(extract: Extract[Any, N]) -> Callable[[RepetitionResults], N]:
    """Make a function that returns the extract of a single simulation as an item's numbers."""
    return lambda extracts: extracts.get_only_result(extract)


#: All items, in the paper's order.
ITEMS: Final[tuple[Item[Any], ...]] = (
    Item(
        "table1",
        "Table 1: error of the mass by window length, in simulation",
        (*window_table.AT_LENGTH.values(), window_table.RAW_UNITS),
        window_table.make_table_1_mass_errors,
        item_sentences.make_mass_error_table_sentences,
        tables=render_table_1_mass_errors,
    ),
    Item(
        "table2",
        "Table 2: the calibration (19)",
        (campaign_tables.IDEAL_LINES, campaign_tables.CHAINED_LINES),
        campaign_tables.make_table_2_calibration_lines,
        item_sentences.make_calibration_line_table_sentences,
        tables=render_table_2_calibration_lines,
    ),
    Item(
        "table3",
        "Table 3: error of the calibrated mass by threshold of the index (11)",
        (campaign_tables.OVER_THRESHOLDS,),
        campaign_tables.make_table_3_errors_by_threshold,
        item_sentences.make_method_error_table_sentences,
        tables=render_table_3_errors_by_threshold,
    ),
    Item(
        "table4",
        "Table 4: error of the calibrated mass by window length",
        (campaign_tables.OVER_WINDOWS,),
        campaign_tables.make_table_4_errors_by_window,
        item_sentences.make_swept_setting_table_sentences,
        tables=render_table_4_errors_by_window,
    ),
    Item(
        "fig2",
        "Figure 2: force, acceleration and speed under the triangular force",
        (excitation_figures.FIGURE_2,),
        _make_getter_of_single_extract(excitation_figures.FIGURE_2),
        item_sentences.make_excitation_figure_sentences,
        picture=paper_pictures.FIGURE_2,
    ),
    Item(
        "fig3",
        "Figure 3: mass and friction in a linear motion, window of 10 s",
        (excitation_figures.FIGURE_3,),
        _make_getter_of_single_extract(excitation_figures.FIGURE_3),
        item_sentences.make_convergence_figure_sentences,
        picture=paper_pictures.FIGURE_3,
    ),
    Item(
        "fig4",
        "Figure 4: yaw inertia and friction in a rotational motion, window of 10 s",
        (excitation_figures.FIGURE_4,),
        _make_getter_of_single_extract(excitation_figures.FIGURE_4),
        item_sentences.make_spin_figure_sentences,
        picture=paper_pictures.FIGURE_4,
    ),
    Item(
        "fig5",
        "Figure 5: force, acceleration, speed and index of a start and stop",
        (campaign_figures.FIGURE_5,),
        _make_getter_of_single_extract(campaign_figures.FIGURE_5),
        item_sentences.make_gate_figure_sentences,
        picture=paper_pictures.FIGURE_5,
    ),
    Item(
        "fig6",
        "Figure 6: masses before calibration",
        (campaign_figures.LOADS,),
        campaign_figures.make_figure_6_raw_mass_data,
        item_sentences.make_raw_mass_figure_sentences,
        picture=paper_pictures.FIGURE_6,
    ),
    Item(
        "fig7",
        "Figure 7: masses after calibration by (19)",
        (campaign_figures.LOADS,),
        campaign_figures.make_figure_7_calibrated_mass_data,
        item_sentences.make_calibrated_mass_figure_sentences,
        picture=paper_pictures.FIGURE_7,
    ),
    Item(
        "fig8",
        "Figure 8: error of the calibrated mass by load",
        (campaign_figures.LOADS,),
        campaign_figures.make_figure_8_error_data,
        item_sentences.make_error_figure_sentences,
        tables=render_figure_8_errors_by_load,
        picture=paper_pictures.FIGURE_8,
    ),
    Item(
        "claims",
        "The claims of the abstract and of the conclusion",
        (
            claims.TEN_SECONDS,
            claims.CAMPAIGN_ERRORS,
            claims.CRUISE_ERRORS,
            campaign_tables.OVER_WINDOWS,
        ),
        claims.check_claims_by_simulation,
        claims_sentences.make_claim_sentences,
        frame=claims_sentences.add_claim_texts,
        tables=render_claims_table,
    ),
)
