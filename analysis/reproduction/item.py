"""One table, figure or list of claims, found anew."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import polars as pl

#: How a sentence calls the methods.
NAMES = {
    "ls": "LS",
    "rls": "RLS",
    "fgls": "FGLS",
    "tls": "TLS",
    "tls_raw": "TLS on raw units",
    "pooled": "pooled LS",
}


#: What is said of a figure that comes without numbers.
NO_NUMBERS: Final = "The paper prints no numbers with this figure."


@dataclass(frozen=True, eq=False)
class Item:
    """What was found, and what to say about it.

    Attributes:
        name: `table1`, `fig5`, `claims`.
        title: what it shows.
        choices: where the paper is silent, what was chosen; a sentence each.
        frame: every number, a column a quantity, its unit in the name.
        findings: where it differs from the paper, and why; a sentence each, made of the numbers.
    """

    name: str
    title: str
    choices: tuple[str, ...]
    frame: pl.DataFrame
    findings: tuple[str, ...]


def lowest(errors: Mapping[float, float]) -> list[float]:
    """Where the error is smallest, ties included."""
    return [at for at, error in errors.items() if error == min(errors.values())]


def listed(words: Iterable[str]) -> str:
    """Words as a sentence lists them."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def percent(share: float, digits: int = 0) -> str:
    """A share as a sentence says it."""
    return f"{100.0 * share:.{digits}f} %"
