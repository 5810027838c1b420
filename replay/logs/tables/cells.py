"""Detect numbers in their common notations in the cells of a text table."""

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import polars as pl

from analysis.model.physical_units import find_pint_unit_name
from replay.logs.tables.table_limits import LIMITS

_EXPONENT: Final = r"(?:[eEdD][+-]?\d+)?"
#: Thousands separators by decimal sign, including no-break and narrow no-break spaces.
_GROUPS: Final = {".": ",'’ \u00a0\u202f", ",": ".'’ \u00a0\u202f"}
#: Indian notation of numbers: 12,34,567. With points, it may be a version or a date.
_LAKHS: Final = {".": r"\d{1,2}(?:,\d{2})+,\d{3}", ",": r"\d{1,2}(?:'\d{2})+'\d{3}"}
_NUMBERS: Final = {
    sign: re.compile(rf"[+-]?(?:\d+[{sign}]?\d*|[{sign}]\d+){_EXPONENT}") for sign in ".,"
}
_WORDS_OF_NUMBERS: Final = frozenset({"nan", "inf", "-inf", "+inf", "-nan", "infinity"})
#: Numbers whose sign may be decimal or a thousands separator: 1.234.
_THOUSANDS: Final = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:[{sign}]\d{{3}})+") for sign in ".,"}
_TIME: Final = re.compile(
    r"(\d{1,4}(?:[-/]|\. ?)\d{1,2}(?:[-/]|\. ?)\d{1,4}\.?[T, ]*)?"
    r"\d{1,2}:\d{2}(:\d{2}([.,:;]\d+)?|[.,]\d+)?"
    r"\s*([AaPp]\.?\s?[Mm]\.?)?\s*(Z|UTC|GMT|[+-]\d{2}(:?\d{2})?)?"
    r"([, ]+\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4})?"
    r"|\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{8}T\d{6}([.,]\d+)?Z?"
)
#: A cell of only these characters is meant as a number or a time.
_NUMBERLIKE: Final = re.compile(r"(?=.*\d)[\d.,;:|\t /+eE-]+")
#: A label of digits: a serial number, or a time in another format (317:08:15:30.020, 08-15-30.020).
_LABEL: Final = re.compile(r"\d[\d.]*(?:[:-]\d[\d.]*){2,}")
#: First characters of a negative number written with a typographic minus or in brackets.
_SIGN_STARTS: Final = "\u2212\u2013("
_SIGNED: Final = re.compile(
    r"^(?:[\u2212\u2013]\s*(?P<a>[\d.,].*)|(?P<b>\d[\d.,]*)-|\((?P<c>\d[\d.,]*)\))$"
)
_TRUTHS: Final = frozenset({"true", "false"})
#: A number with its unit: 3.50 km/h.
_MEASURE: Final = re.compile(
    r"(?P<number>[+-]?[\d.,]*\d(?:[eE][+-]?\d+)?)(?P<unit>\s*[^\d\s.,+-]\S*)"
)


def classify_cell_text(cell: str, decimal_sign: str, *, is_grouped: bool = False) -> str:
    """Classify a cell: empty, number, grouped, measure, time, odd or text.

    A grouped cell is a number with thousands separators, for certain or if the decimal sign of
    other cells leaves no other reading (`maybe grouped`, which `is_grouped` settles). An odd cell
    has digits and signs but is not a number. A measure ends in a unit.
    """
    if not cell:
        return "empty"
    cell = (
        _SIGNED.sub(r"-\g<a>\g<b>\g<c>", cell)
        if cell[0] in _SIGN_STARTS or cell[-1] == "-"
        else cell
    )
    cell = cell[0] + cell[1:].lstrip() if cell[0] in "+-" else cell
    if _NUMBERS[decimal_sign].fullmatch(cell) or cell.lower() in _WORDS_OF_NUMBERS:
        return "number"
    if _TIME.fullmatch(cell) or cell.lower() in _TRUTHS:
        return "time"
    if _SURELY[decimal_sign].fullmatch(cell):
        return "grouped"
    if _GROUPED[decimal_sign].fullmatch(cell):
        return "grouped" if is_grouped else "maybe grouped"
    if _LABEL.fullmatch(cell):
        return "text"
    if _NUMBERLIKE.fullmatch(cell):
        return "odd"
    return "measure" if find_unit_in_cell(cell, decimal_sign) else "text"


#: Kinds of cells that fill a numeric column.
NUMERIC: Final = frozenset({"number", "grouped", "measure", "time"})


def are_most_cells_numeric(cell_classes: Sequence[str], *, result_if_empty: bool = False) -> bool:
    """Whether most cells are numbers or times; `result_if_empty` if there are no cells."""
    present = [each for each in cell_classes if each != "empty"]
    if not present:
        return result_if_empty
    return sum(each in NUMERIC for each in present) >= LIMITS.kind_min_fraction * len(present)


class DecimalMatch(NamedTuple):
    """Whether a cell is a number with the decimal sign, and whether that may group thousands."""

    is_number: bool
    can_be_grouping: bool


def match_decimal_number(cell: str, decimal_sign: str) -> DecimalMatch:
    """Whether a cell is a number with the decimal sign, and whether that may group thousands."""
    signed = decimal_sign in cell and _NUMBERS[decimal_sign].fullmatch(cell) is not None
    return DecimalMatch(signed, signed and _THOUSANDS[decimal_sign].fullmatch(cell) is not None)


@lru_cache(maxsize=1 << 16)
def find_unit_in_cell(cell: str, decimal_sign: str) -> str | None:
    """Unit after the number in a cell, as written (` km/h`); None without a known unit."""
    match = _MEASURE.fullmatch(cell)
    if match is None or not _NUMBERS[decimal_sign].fullmatch(match["number"]):
        return None
    return match["unit"] if find_pint_unit_name(match["unit"]) else None


def find_common_unit_of_cells(cells: Sequence[str], decimal_sign: str) -> str | None:
    """Unit after the numbers of a column, as written, if all have the same; else None."""
    found = {find_unit_in_cell(cell, decimal_sign) for cell in cells}
    return next(iter(found)) if len(found) == 1 else None


def convert_numbers_to_python_notation(
    column: pl.Series, decimal_sign: str, unit: str | None, *, is_grouped: bool
) -> pl.Series:
    """Rewrite the numbers of a column of text in Python's notation.

    Args:
        column: text, (rows,).
        decimal_sign: decimal sign.
        unit: unit after each number, as written; it is removed.
        is_grouped: whether a single sign before three digits is a thousands separator.
    """
    cell = pl.col(column.name).str.strip_chars()
    cell = cell.str.replace(_SIGNED.pattern, "-${a}${b}${c}")
    cell = cell.str.replace(r"^([+-])\s+", "${1}")
    if unit is not None:
        cell = pl.when(cell.str.ends_with(unit)).then(cell.str.strip_suffix(unit)).otherwise(cell)
    form = (
        make_grouped_number_pattern(decimal_sign)
        if is_grouped
        else make_unambiguous_grouping_pattern(decimal_sign)
    )
    has_groups = cell.str.contains(f"^(?:{form})$")
    cell = (
        pl.when(has_groups)
        .then(cell.str.replace_all(f"[{_GROUPS[decimal_sign]}]", ""))
        .otherwise(cell)
    )
    if decimal_sign == ",":
        cell = cell.str.replace(r"^([+-]?\d*),(\d*(?:[eEdD][+-]?\d+)?)$", "${1}.${2}")
    cell = cell.str.replace(r"^([+-]?(?:\d+\.?\d*|\.\d+))[dD]([+-]?\d+)$", "${1}e${2}")
    return column.to_frame().select(cell.alias(column.name)).to_series()


def make_grouped_number_pattern(decimal_sign: str) -> str:
    """Regular expression of a number with thousands separators."""
    groups = rf"\d{{1,3}}(?:[{_GROUPS[decimal_sign]}]\d{{3}})+|{_LAKHS[decimal_sign]}"
    return rf"[+-]?(?:{groups})(?:[{decimal_sign}]\d*)?"


def make_unambiguous_grouping_pattern(decimal_sign: str) -> str:
    """Regular expression of numbers whose thousands separators are certain.

    They are if there are several, if they are blanks, or if a decimal sign follows.
    """
    signs = _GROUPS[decimal_sign]
    ambiguous, blanks = signs[0], signs[1:]
    return (
        rf"[+-]?\d{{1,3}}(?:(?:[{blanks}]\d{{3}})+(?:[{decimal_sign}]\d*)?"
        rf"|(?:[{ambiguous}]\d{{3}}){{2,}}(?:[{decimal_sign}]\d*)?|[{ambiguous}]\d{{3}}[{decimal_sign}]\d*)"
        rf"|[+-]?{_LAKHS[decimal_sign]}(?:[{decimal_sign}]\d*)?"
    )


_GROUPED: Final = {sign: re.compile(make_grouped_number_pattern(sign)) for sign in ".,"}
_SURELY: Final = {sign: re.compile(make_unambiguous_grouping_pattern(sign)) for sign in ".,"}
