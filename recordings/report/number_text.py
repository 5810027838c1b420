"""How numbers and tables are written in the texts of a recording."""

from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10
from typing import Final

from analysis.model.uncertainty_sources import IMU_POSITION, SCALES, TRACK_WIDTH
from analysis.model.verdict import Check

#: What a check that failed led to, where it withholds nothing.
REMARKED: Final = {"widen": "widened", "method": "withheld", "tell": "note"}


def format_check_outcome(check: Check, *, passed: str, failed: str, absent: str) -> str:
    """A check's outcome in a word: a failed one that withholds nothing is named by its consequence.

    Args:
        check: any.
        passed: what to call it when it passed,
        failed: when it failed and withholds a number,
        absent: when it does not apply.
    """
    if check.passed is None:
        return absent
    return passed if check.passed else REMARKED.get(check.consequence, failed)


def format_number(value: object) -> str:
    """A cell of a table: five significant digits, thousands apart, a dash for nothing."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        large = 1e4 <= abs(value) < 1e9
        return f"{value:,.0f}".replace(",", "\u202f") if large else f"{value:.4g}"
    return str(value)


def format_plus_minus(value: float | None, std: float | None) -> str:
    """A value with its standard deviation to two digits, both to the same place."""
    if value is None or std is None or not (std > 0 and isfinite(std)):
        return format_number(value)
    places = max(0, 1 - floor(log10(std)))
    return f"{value:.{places}f} ± {std:.{places}f}"


#: Stands beside a number whose ± lacks the scale error.
SCALE_NOT_KNOWN: Final = "scale error not included"


def scale_unknown_line(names: str, of: str = "") -> str:
    """Name the uncertainties that the machine file lacks.

    Args:
        names: of the sources, as frames have them: `force_gain, wheel_radius`.
        of: the quantity, where it is not the mass.
    """
    whose = f" of {of}" if of else ""
    keys = ", ".join(_UNCERTAINTY_KEYS.get(name, name) for name in names.split(", "))
    return f"±{whose} excludes scale error: set {keys} in the machine file"


#: Keys of the machine file by the source of the uncertainty that they state.
_UNCERTAINTY_KEYS: Final = {
    scale.name: scale.setting.removeprefix("machine.")
    for scale in (*SCALES, TRACK_WIDTH, IMU_POSITION)
}


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table, or "none"."""
    body = [
        "| " + " | ".join(format_number(cell).replace("|", "\\|") for cell in row) + " |"
        for row in rows
    ]
    if not body:
        return "none"
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *body])
