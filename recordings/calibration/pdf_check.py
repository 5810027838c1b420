"""Compare the words of a bundle's PDF with its page."""

import hashlib
import re
import tempfile
from collections import Counter
from collections.abc import Iterable
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from recordings.calibration.bundle_folder import PDF
from recordings.calibration.calibration_report import write_report_pdf
from recordings.calibration.strange_files import read_pdf_words

#: Bullets of a list are drawn at the end of their page.
_BULLET: Final = "•"
#: Characters of a difference that are shown, and of what stands before it.
_SHOWN: Final = 40
_BEFORE: Final = 12
_NUMBER: Final = re.compile(r"[-+−±]?\d[\d,.]*")


def compare_pdf_with_page(folder: Path, sha256: str, html: str) -> tuple[str, str]:
    """Compare the PDF of a bundle with one made from its page.

    With other fonts or another WeasyPrint, pages break elsewhere and parts may be in another order:
    repeated table heads, bullets and page numbers do not count, and in another order only the
    numbers are compared.

    Args:
        folder: the bundle.
        sha256: digest of its PDF.
        html: its page.

    Returns:
        The error, and why it could not be compared; "" each if there is none.
    """
    if find_spec("pypdf") is None:
        return "", "pypdf is not installed (pip install 'payscope[pdf]')"
    with tempfile.TemporaryDirectory(prefix="payscope-") as place:
        own = Path(place) / PDF
        missing = write_report_pdf(html, own)
        if missing:
            return "", missing.removeprefix("no PDF: ")
        wanted = read_pdf_words(own.parent, PDF, hashlib.sha256(own.read_bytes()).hexdigest())
    found = read_pdf_words(folder, PDF, sha256)
    if isinstance(found, str):
        return found, ""
    if isinstance(wanted, str):
        return "", f"the PDF that this payscope makes {wanted}"
    heads = table_heads(html)
    fault = describe_first_difference(
        join_words_without_repeated_heads(wanted, heads),
        join_words_without_repeated_heads(found, heads),
    )
    if fault and count_numbers(wanted, heads) == count_numbers(found, heads):
        return "", "it is laid out with other fonts or another WeasyPrint; its numbers are the same"
    return fault, ""


def join_words_without_repeated_heads(words: Iterable[str], heads: Iterable[str]) -> str:
    """Concatenate words, without heads repeated at page breaks.

    Args:
        words: words of all pages.
        heads: table heads, without spaces.
    """
    text = "".join(word for word in words if word != _BULLET)
    for head in sorted(heads, key=len, reverse=True):
        text = text.replace(head, "")
    return text


def count_numbers(words: Iterable[str], heads: Iterable[str]) -> Counter[str]:
    """Number of occurrences of each number, in any order."""
    in_heads = {number for head in heads for number in _NUMBER.findall(head)}
    plain = (word.strip("()[]:;,.%") for word in words)
    return Counter(word for word in plain if _NUMBER.fullmatch(word) and word not in in_heads)


def describe_first_difference(expected: str, found: str) -> str:
    """First difference of two texts, in words; "" if equal."""
    if expected == found:
        return ""
    pairs = enumerate(zip(expected, found, strict=False))
    at = next((k for k, (a, b) in pairs if a != b), min(len(expected), len(found)))
    begin = max(0, at - _BEFORE)
    there, here = (text[begin : at + _SHOWN] or "nothing" for text in (found, expected))
    return f"reads '{there}' where report.html has '{here}'"


class _TableHeadParser(HTMLParser):
    """HTML parser that collects the text of each `thead`."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002
        if tag == "thead":
            self._inside = True
            self.found.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag == "thead":
            self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.found[-1] += "".join(data.split())


def table_heads(html: str) -> set[str]:
    """Table heads of a page, without spaces."""
    parser = _TableHeadParser()
    parser.feed(html)
    return {head for head in parser.found if head}
