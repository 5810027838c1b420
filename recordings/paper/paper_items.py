"""Registry of items: every reproduced table, figure and list of claims of the paper.

`payscope reproduce`, its progress, the page, the CSV files and the pictures iterate over it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeVar

import polars as pl

from analysis.paper import campaign_figures, campaign_tables, claims, excitation_figures
from analysis.paper import table1 as window_table
from analysis.paper.simulated_sources import Extract, Extracts
from recordings.paper import (
    claims_sentences,
    item_sentences,
    item_tables,
    paper_pictures,
)
from recordings.paper.item_tables import RenderedTable
from recordings.paper.paper_pictures import FigurePicture
from recordings.paper.paper_wording import ItemSentences


class ItemNumbers(Protocol):
    """Result of an item: a frame with every number, and plain values."""

    @property
    def frame(self) -> pl.DataFrame:
        """Frame of all numbers, one column per quantity, with units in the names."""
        ...


N = TypeVar("N", bound=ItemNumbers)


def _one_row_frame(numbers: ItemNumbers) -> pl.DataFrame:
    return numbers.frame


def _render_no_tables(_: pl.DataFrame) -> list[RenderedTable]:
    return []


@dataclass(frozen=True, eq=False)
class Item(Generic[N]):
    """One table, figure or list of claims of the paper.

    Attributes:
        name: name on the command line.
        title: title of the item.
        needs: extracts of simulations that it needs.
        numbers: function that computes its numbers from the extracts.
        make_sentences: function that makes its sentences from the numbers.
        frame: function that makes the frame of the CSV file, with keys as text.
        tables: function that makes the tables of the page.
        picture: height and painter of its picture, or None.
    """

    name: str
    title: str
    needs: tuple[Extract[Any, Any], ...]
    numbers: Callable[[Extracts], N]
    make_sentences: Callable[[N], ItemSentences]
    frame: Callable[[N], pl.DataFrame] = _one_row_frame
    tables: Callable[[pl.DataFrame], list[RenderedTable]] = _render_no_tables
    picture: FigurePicture | None = None


@dataclass(frozen=True, eq=False)
class ItemResult:
    """An item with its numbers and sentences."""

    item: Item[Any]
    frame: pl.DataFrame
    sentences: ItemSentences


def compute_item(item: Item[N], extracts: Extracts) -> ItemResult:
    """Compute an item from the extracts that it needs."""
    numbers = item.numbers(extracts)
    return ItemResult(item, item.frame(numbers), item.make_sentences(numbers))


def _make_extract_getter(extract: Extract[Any, N]) -> Callable[[Extracts], N]:
    """Function that returns the extract of a single simulation as an item's numbers."""
    return lambda extracts: extracts.single_result(extract)


#: In the paper's order.
ITEMS: Final[tuple[Item[Any], ...]] = (
    Item(
        "table1",
        "Table 1: error of the mass by window length, in simulation",
        (*window_table.AT_LENGTH.values(), window_table.RAW_UNITS),
        window_table.make_table_1,
        item_sentences.mass_error_table_sentences,
        tables=item_tables.render_table_1_mass_errors,
    ),
    Item(
        "table2",
        "Table 2: the calibration (19)",
        (campaign_tables.IDEAL_LINES, campaign_tables.CHAINED_LINES),
        campaign_tables.make_table_2,
        item_sentences.calibration_line_table_sentences,
        tables=item_tables.render_table_2_calibration_lines,
    ),
    Item(
        "table3",
        "Table 3: error of the calibrated mass by threshold of the index (11)",
        (campaign_tables.OVER_THRESHOLDS,),
        campaign_tables.make_table_3,
        item_sentences.method_error_table_sentences,
        tables=item_tables.render_table_3_errors_by_threshold,
    ),
    Item(
        "table4",
        "Table 4: error of the calibrated mass by window length",
        (campaign_tables.OVER_WINDOWS,),
        campaign_tables.make_table_4,
        item_sentences.swept_setting_table_sentences,
        tables=item_tables.render_table_4_errors_by_window,
    ),
    Item(
        "fig2",
        "Figure 2: force, acceleration and speed under the triangular force",
        (excitation_figures.FIGURE_2,),
        _make_extract_getter(excitation_figures.FIGURE_2),
        item_sentences.excitation_figure_sentences,
        picture=paper_pictures.FIGURE_2,
    ),
    Item(
        "fig3",
        "Figure 3: mass and friction in a linear motion, window of 10 s",
        (excitation_figures.FIGURE_3,),
        _make_extract_getter(excitation_figures.FIGURE_3),
        item_sentences.convergence_figure_sentences,
        picture=paper_pictures.FIGURE_3,
    ),
    Item(
        "fig4",
        "Figure 4: yaw inertia and friction in a rotational motion, window of 10 s",
        (excitation_figures.FIGURE_4,),
        _make_extract_getter(excitation_figures.FIGURE_4),
        item_sentences.spin_figure_sentences,
        picture=paper_pictures.FIGURE_4,
    ),
    Item(
        "fig5",
        "Figure 5: force, acceleration, speed and index of a start and stop",
        (campaign_figures.FIGURE_5,),
        _make_extract_getter(campaign_figures.FIGURE_5),
        item_sentences.gate_figure_sentences,
        picture=paper_pictures.FIGURE_5,
    ),
    Item(
        "fig6",
        "Figure 6: masses before calibration",
        (campaign_figures.LOADS,),
        campaign_figures.make_figure_6_data,
        item_sentences.raw_mass_figure_sentences,
        picture=paper_pictures.FIGURE_6,
    ),
    Item(
        "fig7",
        "Figure 7: masses after calibration by (19)",
        (campaign_figures.LOADS,),
        campaign_figures.make_figure_7_data,
        item_sentences.calibrated_mass_figure_sentences,
        picture=paper_pictures.FIGURE_7,
    ),
    Item(
        "fig8",
        "Figure 8: error of the calibrated mass by load",
        (campaign_figures.LOADS,),
        campaign_figures.make_figure_8_data,
        item_sentences.error_figure_sentences,
        tables=item_tables.render_figure_8_errors_by_load,
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
        claims.compare_claims,
        claims_sentences.sentences_on_claims,
        frame=claims_sentences.add_claim_texts,
        tables=item_tables.render_claims_table,
    ),
)
