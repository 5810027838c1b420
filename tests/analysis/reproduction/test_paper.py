"""What is typed of the paper is what the paper prints."""

from pathlib import Path

import pytest

from analysis.reproduction import paper


@pytest.fixture(scope="module")
def lines(shared_data: Path) -> list[str]:
    text = shared_data.parent / "paper.txt"
    if not text.is_file():
        pytest.skip("no paper.txt beside shared/data")
    return text.read_text(encoding="utf-8").splitlines()


def _rows(lines: list[str], begins: str, count: int) -> list[list[float]]:
    """The numbers of so many lines from the first that begins so, cells apart by tabs."""
    first = next(i for i, line in enumerate(lines) if line.startswith(begins))
    return [[float(cell) for cell in line.split("\t")[1:]] for line in lines[first : first + count]]


def test_table_1(lines: list[str]) -> None:
    (lengths,) = _rows(lines, "$T_{\\hat{\\phi}}$ [s]\t", 1)
    assert lengths == list(paper.TABLE_1_KG)
    by_method = zip(*paper.TABLE_1_KG.values(), strict=True)
    assert _rows(lines, "LS\t79.46", 4) == [list(row) for row in by_method]


def test_table_2(lines: list[str]) -> None:
    assert _rows(lines, "α\t", 2) == [list(row) for row in paper.TABLE_2.values()]


def test_table_3(lines: list[str]) -> None:
    assert _rows(lines, "0.5\t", 6) == [list(row) for row in paper.TABLE_3_KG.values()]


def test_table_4(lines: list[str]) -> None:
    assert _rows(lines, "200\t", 6) == [list(row) for row in paper.TABLE_4_KG.values()]
