"""`payscope demo`: what it refuses, and what it may replace, is known before its work begins."""

from pathlib import Path

import pytest

from estimators.errors import OutputError, ReviewError
from recordings.review.review_state import STATE
from replay.demo.run_demo import run_demo


class BeginsError(Exception):
    """Nothing was refused."""


def begin(folder: Path, *, overwrites: bool) -> None:
    def stop(stage: str) -> None:
        raise BeginsError(stage)

    run_demo(folder, seed=1, overwrites=overwrites, on_stage=stop)


def test_an_earlier_demo_is_replaced_if_asked_its_review_as_well(tmp_path: Path) -> None:
    (tmp_path / "review").mkdir()
    (tmp_path / "review" / STATE).touch()
    (tmp_path / "shift_1.mcap").touch()
    with pytest.raises(BeginsError, match="simulate"):
        begin(tmp_path, overwrites=True)


@pytest.mark.parametrize("name", ["shift_2.mcap", "shift.cycles.json", "campaign.rrd"])
def test_no_file_of_an_earlier_demo_is_found_only_at_the_end(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    with pytest.raises(OutputError, match=rf"{name}: exists already"):
        begin(tmp_path, overwrites=False)


def test_a_folder_of_others_is_not_taken_for_the_demos_review(tmp_path: Path) -> None:
    (tmp_path / "review").mkdir()
    (tmp_path / "review/thesis.md").touch()
    with pytest.raises(ReviewError, match=r"holds other files \(thesis.md\) but no review"):
        begin(tmp_path, overwrites=True)
