"""Format numbers and tables in texts."""

from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10
from typing import Final

from analysis.model.uncertainty_sources import IMU_POSITION, SCALES, TRACK_WIDTH
from analysis.model.verdict import Check

#: Word for the consequence of a failed check that withholds no mass.
REMARKED: Final = {"widen": "widened", "method": "withheld", "tell": "note"}
#: Word for the consequence of any failed check.
CONSEQUENCES: Final = {"withhold": "no mass", **REMARKED}


def format_check_outcome(check: Check, *, passed: str, failed: str, absent: str) -> str:
    """Format the outcome of a check in a word: a failure that withholds no mass by its consequence.

    Args:
        check: the check.
        passed: word for a passed check.
        failed: word for a failed check that withholds a number.
        absent: word for a check that does not apply.
    """
    if check.passed is None:
        return absent
    return passed if check.passed else REMARKED.get(check.consequence, failed)


def format_unit_suffix(unit: str) -> str:
    """Format the unit after a number; empty for a ratio."""
    return "" if unit == "1" else f" {unit}"


def format_number(value: object) -> str:
    """Format a value for a table cell: 4 significant digits, or whole from 10,000; – for None."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        large = 1e4 <= abs(value) < 1e9
        return f"{value:,.0f}".replace(",", "\u202f") if large else f"{value:.4g}"
    return str(value)


def format_plus_minus(value: float | None, std: float | None) -> str:
    """Format a value ± its standard deviation, which has two digits, to the same decimal place."""
    if value is None or std is None or not (std > 0 and isfinite(std)):
        return format_number(value)
    return f"{round_to_uncertainty(value, std)} ± {round_to_uncertainty(std, std)}"


def round_to_uncertainty(value: float | None, std: float) -> str:
    """Round a value to the decimal place of the second digit of its standard deviation."""
    if value is None or not (std > 0 and isfinite(std)):
        return format_number(value)
    return f"{value:.{max(0, 1 - floor(log10(std)))}f}"


#: Remark on a number whose ± does not include the scale error.
SCALE_NOT_KNOWN: Final = "scale error not included"


def describe_missing_scale_uncertainties(missing_names: str, quantity: str = "") -> str:
    """Name in a line the uncertainties that are missing from the machine file.

    Args:
        missing_names: names of the sources in frames: `force_gain, wheel_radius`.
        quantity: quantity whose ± lacks them, unless it is the mass.
    """
    whose = f" of {quantity}" if quantity else ""
    keys = ", ".join(_UNCERTAINTY_KEYS.get(name, name) for name in missing_names.split(", "))
    return f"±{whose} excludes scale error: set {keys} in the machine file"


#: Key of the machine file that states an uncertainty, by its source.
_UNCERTAINTY_KEYS: Final = {
    scale.name: scale.setting.removeprefix("machine.")
    for scale in (*SCALES, TRACK_WIDTH, IMU_POSITION)
}


def format_markdown_table(
    column_heads: Sequence[str], cell_rows: Iterable[Sequence[object]]
) -> str:
    """Format a Markdown table; "none" without rows."""
    body = [
        "| " + " | ".join(format_number(cell).replace("|", "\\|") for cell in row) + " |"
        for row in cell_rows
    ]
    if not body:
        return "none"
    return "\n".join(
        ["| " + " | ".join(column_heads) + " |", "|" + "---|" * len(column_heads), *body]
    )
