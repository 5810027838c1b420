"""Write the ledger as a spreadsheet: dates as dates, ± as on the page, and a row of units."""

import csv
import datetime as dt
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import polars as pl
import xlsxwriter

from analysis.model.physical_units import NS
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.report.clock_text import ShiftClock
from recordings.report.shift_text import K
from recordings.review.energy_columns import (
    ENERGIES,
    FUEL,
    FUEL_U,
    make_energy_column_name,
    make_uncertainty_column_name,
)
from recordings.review.review_limits import LIMITS
from recordings.review.reviewer_verdicts import LABELS
from recordings.review.shift_ledger import escape_spreadsheet_formula, make_cycle_remark

XLSX: Final = "ledger.xlsx"
TABLE_CSV: Final = "ledger_table.csv"
#: km/h per m/s.
_KM_H: Final = 3.6
_DATE: Final = "yyyy-mm-dd hh:mm:ss"
Row = Mapping[str, Any]
Cell = str | float | int | bool | dt.datetime | None


class TableColumn(NamedTuple):
    """A column: head, unit, source of its value, and number of digits."""

    head: str
    unit: str
    value: Callable[[Row, ShiftClock], Cell]
    digits: int | None = None


def _make_getter_of_scaled_column(
    column_name: str, factor: float = 1.0
) -> Callable[[Row, ShiftClock], Cell]:
    return lambda row, _: None if row[column_name] is None else factor * row[column_name]


def _make_getter_of_column(column_name: str) -> Callable[[Row, ShiftClock], Cell]:
    return lambda row, _: row[column_name]


def _make_dump_time_utc_cell(ledger_row: Row, _clock: ShiftClock) -> Cell:
    if ledger_row["end_unix_ns"] < FIRST_DATE_NS:
        return None
    return dt.datetime.fromtimestamp(ledger_row["end_unix_ns"] // NS, dt.UTC).replace(tzinfo=None)


def _make_local_dump_time_cell(ledger_row: Row, clock: ShiftClock) -> dt.datetime | None:
    if not clock.has_date:
        return None
    return clock.to_local_datetime((ledger_row["end_unix_ns"] - clock.t0_unix_ns) / NS)


def _make_wall_clock_cell(ledger_row: Row, clock: ShiftClock) -> Cell:
    local = _make_local_dump_time_cell(ledger_row, clock)
    return None if local is None else local.replace(tzinfo=None)


def _make_utc_offset_cell(ledger_row: Row, clock: ShiftClock) -> Cell:
    local = _make_local_dump_time_cell(ledger_row, clock)
    offset = None if local is None else local.utcoffset()
    return None if offset is None else offset / dt.timedelta(hours=1)


def _describe_whether_cycle_counts(ledger_row: Row, _clock: ShiftClock) -> Cell:
    return "yes" if ledger_row["counted"] else "no"


def _make_remark_cell(ledger_row: Row, _clock: ShiftClock) -> Cell:
    return make_cycle_remark(ledger_row)


def _make_energy_columns(energy_name: str) -> tuple[TableColumn, TableColumn]:
    """Make the columns of an energy and of its interval."""
    own = {"energy": "energy", "energy_per_t": "energy per tonne"}
    head = own.get(energy_name, f"energy, {energy_name}")
    unit = "kWh/t" if energy_name == "energy_per_t" else "kWh"
    return (
        TableColumn(
            head, unit, _make_getter_of_scaled_column(make_energy_column_name(energy_name)), 4
        ),
        TableColumn(
            f"± {head}",
            unit,
            _make_getter_of_scaled_column(make_uncertainty_column_name(energy_name), K),
            4,
        ),
    )


#: Columns of the table. Times are those of the dump; the offset distinguishes two 02:30 in a night.
COLUMNS: Final = (
    TableColumn("cycle", "1", _make_getter_of_column("cycle"), 0),
    TableColumn("local time", "date", _make_wall_clock_cell),
    TableColumn("offset from UTC", "h", _make_utc_offset_cell, 2),
    TableColumn("UTC", "date", _make_dump_time_utc_cell),
    TableColumn("payload", "kg", _make_getter_of_scaled_column("payload_kg"), 0),
    TableColumn("± (95 %, k = 2)", "kg", _make_getter_of_scaled_column("payload_u_kg", K), 0),
    TableColumn("counted", "yes or no", _describe_whether_cycle_counts),
    TableColumn("quality", "", _make_getter_of_column("quality")),
    TableColumn("remark", "", _make_remark_cell),
    *(TableColumn(name, "", _make_getter_of_column(name)) for name in LABELS),
    TableColumn("note", "", _make_getter_of_column("note")),
    TableColumn("author", "", _make_getter_of_column("author")),
    TableColumn("haul", "m", _make_getter_of_scaled_column("haul_m"), 0),
    TableColumn("top speed", "km/h", _make_getter_of_scaled_column("top_speed_m_s", _KM_H), 1),
    TableColumn("moving", "s", _make_getter_of_scaled_column("moving_s"), 0),
    TableColumn("standing", "s", _make_getter_of_scaled_column("standing_s"), 0),
    *(column for name in ENERGIES for column in _make_energy_columns(name)),
    TableColumn("fuel", "L", _make_getter_of_scaled_column(FUEL), 3),
    TableColumn("± fuel", "L", _make_getter_of_scaled_column(FUEL_U, K), 3),
    TableColumn("id", "", _make_getter_of_column("id")),
)


def make_ledger_table_cells(ledger: pl.DataFrame, clock: ShiftClock) -> list[list[Cell]]:
    """Make the cells of the table, a row per cycle.

    Args:
        ledger: ledger with motion.
        clock: clock of the machine, independent of the reader's time zone.
    """
    return [
        [column.value(row, clock) for column in COLUMNS] for row in ledger.iter_rows(named=True)
    ]


def write_ledger_as_xlsx(ledger: pl.DataFrame, clock: ShiftClock, path: Path) -> None:
    """Write a workbook with frozen heads and units above the rows."""
    # no text becomes a formula or a link, and equal ledgers give equal bytes
    options = {"strings_to_formulas": False, "strings_to_urls": False, "in_memory": True}
    with xlsxwriter.Workbook(str(path), options) as book:
        book.set_properties({"created": dt.datetime(2000, 1, 1, tzinfo=dt.UTC)})
        sheet = book.add_worksheet("ledger")
        bold, quiet = book.add_format({"bold": True}), book.add_format({"italic": True})
        sheet.freeze_panes(2, 1)
        rows = make_ledger_table_cells(ledger, clock)
        for place, column in enumerate(COLUMNS):
            form = "0" if not column.digits else f"0.{'0' * column.digits}"
            shown = book.add_format({"num_format": _DATE if column.unit == "date" else form})
            sheet.set_column(
                place, place, LIMITS.date_column_characters if column.unit == "date" else None
            )
            sheet.write_string(0, place, column.head, bold)
            sheet.write_string(1, place, column.unit, quiet)
            for number, row in enumerate(rows, start=2):
                if (cell := row[place]) not in (None, ""):
                    sheet.write(number, place, cell, None if isinstance(cell, str) else shown)


def write_ledger_as_spreadsheet_csv(
    ledger: pl.DataFrame, clock: ShiftClock, path: Path, *, has_decimal_comma: bool = False
) -> None:
    """Write the same table as CSV that spreadsheets open directly.

    Args:
        ledger: ledger with motion.
        clock: clock of the machine.
        path: file to write.
        has_decimal_comma: whether to write 1,5 and separate cells by semicolons.
    """
    with path.open("w", encoding="utf-8-sig", newline="") as file:
        writer = csv.writer(file, delimiter=";" if has_decimal_comma else ",")
        writer.writerow([column.head for column in COLUMNS])
        writer.writerow([column.unit for column in COLUMNS])
        for row in make_ledger_table_cells(ledger, clock):
            cells = zip(row, COLUMNS, strict=True)
            writer.writerow(
                [
                    _format_csv_cell(cell, c.digits, has_decimal_comma=has_decimal_comma)
                    for cell, c in cells
                ]
            )


def _format_csv_cell(cell: Cell, digits: int | None, *, has_decimal_comma: bool) -> str:
    if cell is None:
        return ""
    if isinstance(cell, dt.datetime):
        return f"{cell:%Y-%m-%d %H:%M:%S}"
    if isinstance(cell, str):
        return escape_spreadsheet_formula(cell)
    text = f"{cell:.{digits or 0}f}"
    return text.replace(".", ",") if has_decimal_comma else text
