"""What was found, as files: a page whose tables hold together, CSV, pictures; all or none."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from estimators.errors import OutputError
from recordings.paper.paper_items import ITEMS, Item, ItemResult
from recordings.paper.paper_page import require_writable_reproduction_folder, write_reproduction
from recordings.paper.paper_wording import ItemSentences

ITEM: dict[str, Item[Any]] = {item.name: item for item in ITEMS}


def _table_3() -> ItemResult:
    rows = [
        {
            "threshold_nat": at,
            "method": method,
            "trials": 2,
            "paper_kg": printed,
            "bound_kg": 6.0,
            **{f"{name}{end}": error for name in ("run_kg", "run_left_out_kg") for end, error in
               (("", 7.0 + at), ("_low", low), ("_high", 9.0))},
        }
        for at, low in ((0.5, 6.0), (0.7, None))
        for method, printed in (("ls", 22.6), ("pooled", None))
    ]  # fmt: skip
    item = replace(ITEM["table3"], title="Table 3")
    return ItemResult(item, pl.DataFrame(rows), ItemSentences(("Chosen.",), ("Found | told.",)))


def _fig_2() -> ItemResult:
    series = {"t_s": [0.0, 1.0, 2.0], "force_x_N": [0.0, 5e3, None]}
    series |= {"regressor_acc_x_m_s2": [0.0, 1.0, 0.5], "speed_x_m_s": [0.0, 0.5, 1.0]}
    item = replace(ITEM["fig2"], title="Figure 2")
    return ItemResult(item, pl.DataFrame(series), ItemSentences(("Chosen.",), ("Found.",)))


def test_a_table_has_the_papers_number_beside_ours_and_a_dash_for_what_there_is_not() -> None:
    within, without = ITEM["table3"].tables(_table_3().frame)
    assert within.header == ["threshold, nat", "bound", "LS", "paper", "pooled LS"]
    assert within.rows == [
        ["0.5", "6.0", "7.5 [6.0, 9.0]", "22.60", "7.5 [6.0, 9.0]"],
        ["0.7", "6.0", "7.7", "22.60", "7.7"],  # one campaign has no interval
    ]
    assert without.header == ["threshold, nat", "LS", "pooled LS"]


def test_the_page_holds_every_sentence_table_and_picture(tmp_path: Path) -> None:
    files = write_reproduction(
        [_table_3(), _fig_2()], tmp_path, "md", "By two campaigns.", overwrites=False
    )
    assert files == [tmp_path / "reproduction.md", tmp_path / "fig2.png"]
    lines = files[0].read_text(encoding="utf-8").splitlines()
    for line in ("By two campaigns.", "## Table 3", "- Found | told.", "- Chosen.", "- Found.",
                 "![Figure 2](fig2.png)", "| 0.5 | 7.5 [6.0, 9.0] | 7.5 [6.0, 9.0] |"):  # fmt: skip
        assert line in lines
    rules = [line for line in lines if line.startswith("|---")]
    assert rules == ["|---|---:|---:|---:|---:|", "|---|---:|---:|"]
    assert files[1].read_bytes().startswith(b"\x89PNG")


def test_csv_has_a_file_an_item_and_the_sentences(tmp_path: Path) -> None:
    files = write_reproduction([_table_3()], tmp_path, "csv", "By two campaigns.", overwrites=False)
    assert [path.name for path in files] == ["table3.csv", "findings.csv"]
    assert pl.read_csv(files[0]).height == 4
    assert pl.read_csv(files[1])["sentence"].to_list() == [
        "By two campaigns.",
        "Found | told.",
        "Chosen.",
    ]


def test_what_is_there_is_refused_before_the_work_and_replaced_only_when_forced(
    tmp_path: Path,
) -> None:
    (tmp_path / "fig2.png").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"fig2\.png: exists already"):
        require_writable_reproduction_folder(
            [ITEM["table3"], ITEM["fig2"]], tmp_path, "md", overwrites=False
        )
    require_writable_reproduction_folder([ITEM["table3"]], tmp_path, "md", overwrites=False)
    with pytest.raises(OutputError, match="exists already"):
        write_reproduction([_fig_2()], tmp_path, "md", "", overwrites=False)
    assert [path.name for path in tmp_path.iterdir()] == ["fig2.png"]
    write_reproduction([_fig_2()], tmp_path, "md", "", overwrites=True)
    assert (tmp_path / "fig2.png").read_bytes() != b"mine"
