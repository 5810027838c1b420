"""Tables of the page: frames of the items with numbers as text."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from analysis.paper import campaign_tables, printed_numbers
from recordings.paper.paper_wording import NAMES

#: By method, what its row of a group says.
_Row = dict[str, Any]


@dataclass(frozen=True)
class RenderedTable:
    """One table: caption, header, rows, and the number of leading text columns."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    texts: int = 1


def render_table_1_mass_errors(frame: pl.DataFrame) -> list[RenderedTable]:
    """Tables of errors by window length, absolute and relative to the bound."""
    errors = table_beside_printed_numbers(
        frame,
        "window_s",
        "window, s",
        lambda row: number_with_interval_text(row, "rmse_kg"),
        "bound_kg",
    )
    ratios = table_by_method(
        frame, "window_s", "window, s", lambda row: _format_number(row["over_bound_1"], 2)
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
    """Table of slope and offset by method."""
    of = {(row["chain"], row["method"]): row for row in frame.iter_rows(named=True)}
    methods = frame["method"].unique(maintain_order=True)
    rows: list[list[str]] = []
    for method in methods:
        cells = [NAMES[method]]
        for name, digits in (("alpha_1", 3), ("beta_kg", 1)):
            ideal, front = of["ideal", method], of["front_axle", method]
            cells += [
                _format_number(ideal[f"paper_{name}"], digits),
                number_with_interval_text(ideal, name, digits),
                number_with_interval_text(front, name, digits),
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
    """Tables of errors by threshold, with the own load in the fit and without it."""
    return _render_error_tables_by_setting(frame, campaign_tables.THRESHOLD, "threshold, nat")


def render_table_4_errors_by_window(frame: pl.DataFrame) -> list[RenderedTable]:
    """Tables of errors by window length, with the own load in the fit and without it."""
    return _render_error_tables_by_setting(frame, campaign_tables.WINDOW, "samples")


def _render_error_tables_by_setting(
    frame: pl.DataFrame, setting: str, title: str
) -> list[RenderedTable]:
    campaigns = frame["trials"].max()
    within = table_beside_printed_numbers(
        frame, setting, title, lambda row: number_with_interval_text(row, "run_kg"), "bound_kg"
    )
    without = table_by_method(
        frame, setting, title, lambda row: number_with_interval_text(row, "run_left_out_kg")
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
    """Tables of errors by load, with the load in the fit and without it."""
    header, rows = table_by_method(
        frame,
        "load_kg",
        "load, kg",
        lambda row: f"{_format_number(row['rms_kg'])} / {_format_number(row['rms_left_out_kg'])}",
    )
    return [RenderedTable("RMS error in kg: load in the fit / left out", header, rows)]


def render_claims_table(frame: pl.DataFrame) -> list[RenderedTable]:
    """Table with one row per finding."""
    rows = [
        [
            row["claim"],
            row["case"],
            row["paper"],
            number_with_interval_text(row, "found_kg", 2),
            f"{row['of_mass_percent']:.2f} %",
            f"{row['of_load_range_percent']:.1f} %",
            "–" if row["smaller_percent"] is None else f"{row['smaller_percent']:.1f} %",
        ]
        for row in frame.iter_rows(named=True)
    ]
    header = ["claim", "case", "paper", "found, kg [95 %]"]
    header += ["of the machine's mass", "of the payload range", "smaller"]
    return [RenderedTable("Each claim as we find it", header, rows, texts=3)]


def table_by_method(
    frame: pl.DataFrame, key: str, title: str, cell: Callable[[_Row], str]
) -> tuple[list[str], list[list[str]]]:
    """Header and rows with one row per value of `key` and one column per method."""
    methods = list(frame["method"].unique(maintain_order=True))
    rows = [
        [_format_parameter(at), *(cell(by[m]) if m in by else "–" for m in methods)]
        for at, by in _group_by_key_and_method(frame, key)
    ]
    return [title, *(NAMES[m] for m in methods)], rows


def table_beside_printed_numbers(
    frame: pl.DataFrame, key: str, title: str, cell: Callable[[_Row], str], bound: str
) -> tuple[list[str], list[list[str]]]:
    """Header and rows: the bound, then each method's number followed by the paper's."""
    methods = list(frame["method"].unique(maintain_order=True))
    header = [title, "bound"]
    for method in methods:
        header += [NAMES[method], *(["paper"] if method in printed_numbers.METHODS else [])]
    rows: list[list[str]] = []
    for at, by in _group_by_key_and_method(frame, key):
        cells = [_format_parameter(at), _format_number(next(iter(by.values()))[bound])]
        for method in methods:
            cells.append(cell(by[method]))
            if method in printed_numbers.METHODS:
                cells.append(_format_number(by[method]["paper_kg"], 2))
        rows.append(cells)
    return header, rows


def _group_by_key_and_method(frame: pl.DataFrame, key: str) -> list[tuple[float, dict[str, _Row]]]:
    groups: dict[float, dict[str, _Row]] = {}
    for row in frame.iter_rows(named=True):
        groups.setdefault(row[key], {})[row["method"]] = row
    return list(groups.items())


def _format_parameter(value: float) -> str:
    return f"{value:g}"


def _format_number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:,.{digits}f}"


def number_with_interval_text(row: _Row, name: str, digits: int = 1) -> str:
    """Number with its interval, if there is one."""
    value, low, high = (row[name + end] for end in ("", "_low", "_high"))
    text = _format_number(value, digits)
    if low is None or high is None:
        return text
    return f"{text} [{_format_number(low, digits)}, {_format_number(high, digits)}]"
