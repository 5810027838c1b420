"""Wording of sentences and tables of the reproduction."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from analysis.model.methods import METHODS

#: Names of the methods in sentences.
NAMES: Final = {
    **{name: method.title for name, method in METHODS.items()},
    "tls_raw": "TLS on raw units",
}
#: Sentence on a figure for which the paper prints no numbers.
NO_NUMBERS: Final = "The paper prints no numbers with this figure."


class ItemSentences(NamedTuple):
    """Sentences of one item.

    Attributes:
        choices: choices made because the paper does not state them.
        findings: numbers found, differences from the paper, and their reasons.
    """

    choices: tuple[str, ...]
    findings: tuple[str, ...]


def join_words_as_list(words: Iterable[str]) -> str:
    """Join words as a list in a sentence."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def format_percent(fraction: float, digits: int = 0) -> str:
    """Format a fraction as a percentage for a sentence."""
    return f"{100.0 * fraction:.{digits}f} %"
