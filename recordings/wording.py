"""How numbers and tables are written in the texts of a recording."""

from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10
from typing import Final

from analysis.check import Check

#: What a check that failed led to, where it withholds nothing.
REMARKED: Final = {"widen": "wider", "method": "withheld", "tell": "there"}


def outcome(check: Check, *, passed: str, failed: str, absent: str) -> str:
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


def number(value: object) -> str:
    """A cell of a table: five significant digits, thousands apart, a dash for nothing."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        large = 1e4 <= abs(value) < 1e9
        return f"{value:,.0f}".replace(",", "\u202f") if large else f"{value:.4g}"
    return str(value)


def plus_minus(value: float | None, std: float | None) -> str:
    """A value with its standard deviation to two digits, both to the same place."""
    if value is None or std is None or not (std > 0 and isfinite(std)):
        return number(value)
    places = max(0, 1 - floor(log10(std)))
    return f"{value:.{places}f} ± {std:.{places}f}"


#: Stands beside tonnes whose ± lacks the scale.
SCALE_NOT_KNOWN: Final = "scale not known"


def scale_unknown_line(names: str, of: str = "") -> str:
    """What the machine file should state of an answer's scale and does not.

    Args:
        names: of the sources, as frames have them.
        of: what the answer is, where it is not the mass.
    """
    whose = f" of {of}" if of else ""
    return (
        f"{SCALE_NOT_KNOWN}: the machine file gives no uncertainty of {names}, "
        f"so none is in the ±{whose}"
    )


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table, or "none"."""
    body = [
        "| " + " | ".join(number(cell).replace("|", "\\|") for cell in row) + " |" for row in rows
    ]
    if not body:
        return "none"
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *body])
