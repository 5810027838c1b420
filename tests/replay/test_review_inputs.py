"""What a review is given: folders, logs that overlap, evidence; and what it refuses in one line."""

import dataclasses
import io
import json
import random
from itertools import pairwise
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from estimators.errors import LogError, ReviewError
from recordings.review.review_page import UsedCalibration
from recordings.review.review_state import RECORDING, FailedCheck
from replay.calibration.apply_evidence import CalibrationRequest
from replay.calibration.calibrate_campaign import CalibrationOutcome, calibrate_from_campaign
from replay.commands.review import print_shift_review
from replay.logs import expand_log_folders
from replay.review.review_shift import ReviewOptions, review_shift
from replay.review.write_review import ShiftReview
from tests.replay.attacker import key_files
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import campaign_folder
from tests.replay.sledge_shift import PAYLOADS_KG, sledge_shift, write_parts

SHORT = PAYLOADS_KG[:3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign's folder, the machine file in it, and one log of a shift beside."""
    folder = tmp_path_factory.mktemp("sledges")
    campaign_folder(folder)
    (folder / "shift").mkdir()
    sledge_shift(SHORT).write_csv(folder / "shift/whole.csv")
    return folder


@pytest.fixture(scope="module")
def machine(folder: Path) -> Path:
    return folder / "sledge.toml"


@pytest.fixture(scope="module")
def reviewed(folder: Path, machine: Path) -> ShiftReview:
    return review_shift([folder / "shift"], machine, folder / "reviewed", ReviewOptions())


@pytest.fixture(scope="module")
def evidence(folder: Path) -> CalibrationOutcome:
    return calibrate_from_campaign(folder / "campaign.toml", folder / "evidence")


def test_a_folder_stands_for_the_bags_in_it_and_those_of_its_folders(tmp_path: Path) -> None:
    (tmp_path / "bag_2").mkdir()
    (tmp_path / "bag_2/metadata.yaml").touch()
    (tmp_path / "day_2/bag_3").mkdir(parents=True)
    (tmp_path / "day_2/bag_3/metadata.yaml").touch()
    (tmp_path / "torn").mkdir()
    names = ["a.bag", "b.mcap", "torn/torn_0.db3"]
    others = ["a.bag.truth.json", "notes.csv", ".hidden.bag", "torn/ledger.csv"]
    for name in (*names, *others):
        (tmp_path / name).touch()
    found = [each.relative_to(tmp_path).as_posix() for each in expand_log_folders([tmp_path])]
    assert found == ["a.bag", "b.mcap", "bag_2", "day_2/bag_3", "torn/torn_0.db3"]
    assert expand_log_folders([tmp_path / "a.bag", tmp_path]) == expand_log_folders([tmp_path])


def test_a_folder_of_tables_alone_is_a_shift_too(folder: Path) -> None:
    assert expand_log_folders([folder / "shift"]) == [folder / "shift/whole.csv"]


def test_a_review_that_is_refused_leaves_nothing_behind(machine: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match="empty: contains no log"):
        review_shift([tmp_path / "empty"], machine, tmp_path / "new", ReviewOptions())
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").touch()
    with pytest.raises(ReviewError, match=r"mine: holds other files \(notes.txt\) but no review"):
        review_shift([tmp_path / "empty"], machine, tmp_path / "mine", ReviewOptions())
    left = {each.relative_to(tmp_path).as_posix() for each in tmp_path.rglob("*")}
    assert left == {"empty", "mine", "mine/notes.txt"}


@pytest.mark.heavy
def test_logs_that_overlap_by_seconds_in_any_order_give_the_ledger_of_the_whole(
    machine: Path, reviewed: ShiftReview, tmp_path: Path
) -> None:
    parts = write_parts(sledge_shift(SHORT), tmp_path / "shift", 4, overlap_s=6.0)
    assert sum(pl.read_csv(part).height for part in parts) > sledge_shift(SHORT).height
    # one is named twice, by its name and by its folder
    named = [parts[3], parts[1], tmp_path / "shift"]
    again = review_shift(named, machine, tmp_path / "review", ReviewOptions())
    assert again.ledger.equals(reviewed.ledger)
    assert again.ledger["payload_kg"].to_list() == pytest.approx(SHORT, abs=1.0)


@pytest.mark.heavy
def test_ten_cuts_anywhere_give_the_ledger_of_the_whole(
    machine: Path, reviewed: ShiftReview, tmp_path: Path
) -> None:
    whole = sledge_shift(SHORT)
    cuts = [0, *sorted(random.Random(14).sample(range(1, whole.height), 10)), whole.height]
    for number, (begin, end) in enumerate(pairwise(cuts)):
        whole[begin:end].write_csv(tmp_path / f"part_{number:02}.csv")
    again = review_shift([tmp_path], machine, tmp_path / "review", ReviewOptions())
    assert again.ledger.equals(reviewed.ledger)


@pytest.mark.heavy
def test_payloads_and_tonnes_are_on_the_line_of_the_evidence(
    folder: Path,
    machine: Path,
    reviewed: ShiftReview,
    evidence: CalibrationOutcome,
    tmp_path: Path,
    payscope: Payscope,
) -> None:
    out = tmp_path / "review"
    ask = ("-m", machine, "-o", out, "--calibration", evidence.folder)
    said = payscope("review", folder / "shift", *ask)
    assert said.status == 0, said.err
    assert f"evidence {evidence.document.id}" in said.out
    assert evidence.document.id in (out / "review.html").read_text(encoding="utf-8")
    rows = pl.read_parquet(out / "ledger.parquet")
    off = (rows["payload_kg"] - pl.Series(SHORT)).abs()
    assert (off < 3.0 * rows["payload_u_kg"]).all()
    assert rows["payload_kg"].to_list() != reviewed.ledger["payload_kg"].to_list()
    told = json.loads(payscope("review", folder / "shift", *ask, "--json").out)
    assert not told["replayed"]
    assert told["shift"]["payload_kg"] == pytest.approx(rows["payload_kg"].sum())
    assert abs(told["shift"]["payload_kg"] - sum(SHORT)) < 2.0 * told["shift"]["payload_u_kg"]
    # counted anew, without logs and evidence, it is on that line as well
    anew = json.loads(payscope("review", out, "--json").out)
    assert anew["shift"] == pytest.approx(told["shift"])
    assert anew["calibration"] == told["calibration"]
    assert pl.read_parquet(out / "ledger.parquet").equals(rows)


@pytest.mark.heavy
def test_a_load_outside_of_what_was_calibrated_has_no_payload_and_says_so(tmp_path: Path) -> None:
    """The ticket is so rough that the evidence determines the scale."""
    campaign_folder(tmp_path)
    machine = tmp_path / "sledge.toml"
    known = machine.read_text(encoding="utf-8")
    rough = known.replace("empty_mass_u_kg = 0.05", "empty_mass_u_kg = 2.0")
    machine.write_text(rough, encoding="utf-8")
    evidence = calibrate_from_campaign(tmp_path / "campaign.toml", tmp_path / "evidence")
    sledge_shift((55.0, 95.0, 50.0)).write_csv(tmp_path / "heavy.csv")
    asked = ReviewOptions(calibration=CalibrationRequest(evidence.folder))
    made = review_shift([tmp_path / "heavy.csv"], machine, tmp_path / "review", asked)
    assert made.ledger["payload_kg"].is_null().to_list() == [False, True, False]
    assert "outside of the calibrated range" in made.ledger["withheld_for"][1]
    assert made.ledger["counted"].to_list() == [True, False, True]


@pytest.mark.heavy
def test_evidence_that_is_not_of_this_shift_is_refused_in_a_line(
    folder: Path, machine: Path, evidence: CalibrationOutcome, tmp_path: Path, payscope: Payscope
) -> None:
    def refused(*more: object, log: Path = folder / "shift/whole.csv", says: str) -> None:
        ask = ("-m", machine, "-o", tmp_path / "r", "--calibration", evidence.folder)
        join_to_one_line(payscope("review", log, *ask, *more), says)
        assert not (tmp_path / "r/review.html").exists()

    refused("--require-signed", says="unsigned")
    refused("--key", key_files(tmp_path)[1], says="cannot be used to calibrate")
    refused("--set", "machine.name=other", says="not to 'other'")
    later = tmp_path / "later.csv"
    sledge_shift(SHORT[:1], begin_s=2_000_000_000.0).write_csv(later)
    refused(log=later, says="expired on")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere.bag"], "no such file"),
        (["empty"], "empty: contains no log"),
        (["shift", "--target", "-3"], "--target"),
        (["shift", "--require-signed"], "need --calibration"),
        (["shift", "--calibration", "nowhere"], "nowhere"),
        (["broken.mcap"], "broken.mcap"),
    ],
)
def test_wrong_input_is_one_line(
    folder: Path, machine: Path, words: list[str], says: str, payscope: Payscope,
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:  # fmt: skip
    (folder / "empty").mkdir(exist_ok=True)
    (folder / "broken.mcap").write_bytes(b"no log at all")
    monkeypatch.chdir(folder)
    said: Any = payscope("review", *words, "-m", machine, "-o", tmp_path / "r")
    assert said.status == 2
    assert says in said.err
    assert "Traceback" not in said.err
    assert not (tmp_path / "r" / RECORDING).exists()


@pytest.mark.heavy
@given(st.text(min_size=1, max_size=60))
def test_no_name_reaches_the_terminal_as_a_command(reviewed: ShiftReview, name: str) -> None:
    check = FailedCheck(
        check=name, value=1.0, limit=name, consequence="tell", meaning=name, remedy=name
    )
    state = reviewed.state.model_copy(update={"losses": (name,), "failed": (check,)})
    said: list[int] = []
    for text in ("plain", name):
        calibration = UsedCalibration(text, text)
        made = dataclasses.replace(reviewed, state=state, calibration=calibration)
        screen = Console(file=io.StringIO(), force_terminal=False, width=200, highlight=False)
        print_shift_review(screen, made)
        told: str = screen.file.getvalue()  # pyright: ignore[reportAttributeAccessIssue]
        assert not [c for c in told if not c.isprintable() and c != "\n"]
        assert "\nchecks with a remark: " in told  # it withholds nothing
        said.append(told.count("\n"))
    assert said[0] == said[1]
