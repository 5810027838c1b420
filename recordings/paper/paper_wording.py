"""How sentences and tables of the reproduction are worded."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from analysis.model.methods import METHODS

#: How a sentence calls the methods.
NAMES: Final = {
    **{name: method.title for name, method in METHODS.items()},
    "tls_raw": "TLS on raw units",
}
#: What is said of a figure that comes without numbers.
NO_NUMBERS: Final = "The paper prints no numbers with this figure."


class ItemSentences(NamedTuple):
    """The sentences of one item.

    Attributes:
        choices: where the paper is silent, the choice made.
        findings: where ours differs from the paper, and why; made of the numbers.
    """

    choices: tuple[str, ...]
    findings: tuple[str, ...]


def join_words(words: Iterable[str]) -> str:
    """Words as a sentence lists them."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def format_percent(share: float, digits: int = 0) -> str:
    """A share as a sentence says it."""
    return f"{100.0 * share:.{digits}f} %"
