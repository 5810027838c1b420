"""What is typed of the paper is what the paper prints."""

import os
from pathlib import Path

import pytest

from analysis.paper import printed_numbers
from tests.conftest import REPO


@pytest.fixture(scope="module")
def lines() -> list[str]:
    named = os.environ.get("PAYSCOPE_SHARED_DATA")
    folders = [Path(named).parent] if named else [p / "shared" for p in REPO.parents]
    text = next((f / "paper.txt" for f in folders if (f / "paper.txt").is_file()), None)
    if text is None:
        pytest.skip("the paper's own text: no shared/paper.txt in any parent folder")
    return text.read_text(encoding="utf-8").splitlines()


def _rows(lines: list[str], begins: str, count: int) -> list[list[float]]:
    """The numbers of so many lines from the first that begins so, cells apart by tabs."""
    first = next(i for i, line in enumerate(lines) if line.startswith(begins))
    return [[float(cell) for cell in line.split("\t")[1:]] for line in lines[first : first + count]]


def test_table_1(lines: list[str]) -> None:
    (lengths,) = _rows(lines, "$T_{\\hat{\\phi}}$ [s]\t", 1)
    assert lengths == list(printed_numbers.TABLE_1_KG)
    by_method = zip(*printed_numbers.TABLE_1_KG.values(), strict=True)
    assert _rows(lines, "LS\t79.46", 4) == [list(row) for row in by_method]


def test_table_2(lines: list[str]) -> None:
    assert _rows(lines, "α\t", 2) == [list(row) for row in printed_numbers.TABLE_2.values()]


def test_table_3(lines: list[str]) -> None:
    assert _rows(lines, "0.5\t", 6) == [list(row) for row in printed_numbers.TABLE_3_KG.values()]


def test_table_4(lines: list[str]) -> None:
    assert _rows(lines, "200\t", 6) == [list(row) for row in printed_numbers.TABLE_4_KG.values()]
