"""A shift reviewed: what is found against the truth, what is kept, and what a killed one leaves."""

import fcntl
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario
from benchmarks.energy import TrueEnergy
from estimators.errors import PayscopeError, ReviewError
from recordings import read_frame
from recordings.review.review_state import RECORDING, STATE
from replay import load_machine, open_log, run
from replay.review.review_shift import ReviewOptions, find_truncated_logs, review_shift
from replay.review.write_review import ShiftReview
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.kept_replays import replays_anew
from tests.replay.shift_review import SCENARIO, shift_folder, verdict

pytestmark = pytest.mark.usefixtures("kept_replays")

OUTPUTS = {
    *("ledger.csv", "ledger.parquet", "ledger.xlsx", "ledger_table.csv"),
    *("review.html", "review.json", "shift.rrd"),
}


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path, dict[str, Any]]:
    return shift_folder(tmp_path_factory.mktemp("driven"))


@pytest.fixture(scope="module")
def reviewed(driven: tuple[list[Path], Path, Any], tmp_path_factory: Any) -> ShiftReview:
    logs, machine, _ = driven
    folder = tmp_path_factory.mktemp("reviewed") / "review"
    return review_shift(logs, machine, folder, ReviewOptions(target_kg=700.0))


@pytest.fixture
def folder(reviewed: ShiftReview, tmp_path: Path) -> Path:
    """A copy of the review, to be changed."""
    return Path(shutil.copytree(reviewed.folder, tmp_path / "review"))


@pytest.mark.heavy
def test_the_energy_of_each_cycle_is_the_simulators_own_work(
    reviewed: ShiftReview,
) -> None:
    t0_ns = reviewed.state.t0_unix_ns
    digging = read_frame(reviewed.folder / RECORDING, "digging")
    digs = digging.select("start_t_ns", "end_t_ns").rows()
    true = TrueEnergy(SCENARIO, [(s + t0_ns, e + t0_ns) for s, e in digs])
    rows = reviewed.ledger.drop_nulls("energy_kWh")
    assert rows.height >= 3
    for row in rows.iter_rows(named=True):
        parts = true.during(row["start_unix_ns"], row["end_unix_ns"])
        assert row["energy_kWh"] == pytest.approx(parts[0], rel=0.03)
        for part, expected in zip(("friction", "digging", "slope"), parts[[3, 4, 2]], strict=True):
            off, u = row[f"{part}_kWh"] - expected, row[f"{part}_u_kWh"]
            assert abs(off) < 3.0 * u + 0.01 * parts[0], part
    whole = reviewed.to_dict()["energy"]["rows"][0]
    assert whole["phase"] == "whole"
    assert whole["work"]["kWh"] == pytest.approx(rows["energy_kWh"].sum(), rel=1e-4)


def test_every_cycle_is_found_at_its_dump_and_the_tonnes_are_within_their_interval(
    driven: tuple[Any, Any, dict[str, Any]], reviewed: ShiftReview
) -> None:
    cycles = driven[2]["cycles"]
    dumped = np.array([each["dump_ns"] for each in cycles])
    found = reviewed.ledger["dump_unix_ns"].to_numpy()
    assert found.size == dumped.size
    assert np.abs(found - dumped).max() < 5e9
    payload = np.array([each["payload_kg"] for each in cycles])
    off = reviewed.ledger["payload_kg"].to_numpy() - payload
    assert (np.abs(off) < 3.0 * reviewed.ledger["payload_u_kg"].to_numpy()).all()
    total = abs(reviewed.shift["payload_kg"] - payload.sum())
    assert total < 2.0 * reviewed.shift["payload_u_kg"]


def test_the_folder_holds_the_ledger_twice_the_recording_and_the_page(
    reviewed: ShiftReview,
) -> None:
    shown = {each.name for each in reviewed.folder.iterdir() if not each.name.startswith(".")}
    assert shown == OUTPUTS
    assert pl.read_parquet(reviewed.folder / "ledger.parquet").equals(reviewed.ledger)
    assert pl.read_csv(reviewed.folder / "ledger.csv").height == reviewed.ledger.height
    kept = read_frame(reviewed.folder / RECORDING, "cycles")
    assert kept["payload_kg"].to_list() == reviewed.ledger["payload_kg"].to_list()


@pytest.mark.heavy
def test_a_second_review_does_not_replay_unless_something_that_counts_has_changed(
    driven: tuple[list[Path], Path, Any], folder: Path
) -> None:
    logs, machine, _ = driven
    before = (folder / "ledger.parquet").read_bytes()
    again = review_shift(logs, machine, folder, ReviewOptions(target_kg=600.0))
    assert not again.replayed
    assert (folder / "ledger.parquet").read_bytes() == before
    page = (folder / "review.html").read_text(encoding="utf-8")
    assert '<th scope="row">target_kg</th><td>700.0</td><td>600.0</td>' in page
    # a recording that was replaced by another recording is not believed
    with (folder / RECORDING).open("ab") as recording:
        recording.write(b"x")
    assert review_shift(logs, machine, folder, ReviewOptions()).replayed
    assert (folder / "ledger.parquet").read_bytes() == before


def test_a_rejected_cycle_is_listed_with_author_and_time_and_is_not_counted(
    driven: tuple[list[Path], Path, Any], reviewed: ShiftReview, folder: Path
) -> None:
    logs, machine, _ = driven
    third = reviewed.ledger.row(2, named=True)
    said = verdict(third["id"], 'reject = true\nnote = "=<b>wall</b>"\nproduct = "gravel"\n')
    (folder / "verdicts.toml").write_text(said, encoding="utf-8")
    again = review_shift(logs, machine, folder, ReviewOptions())
    assert (folder / "verdicts.toml").read_text(encoding="utf-8") == said
    assert again.shift["cycles_rejected"] == 1
    assert again.shift["payload_kg"] == pytest.approx(
        reviewed.shift["payload_kg"] - third["payload_kg"]
    )
    row = again.ledger.row(2, named=True)
    assert (row["counted"], row["author"], row["said"]) == (
        False,
        "R. Meier",
        "2026-01-02T03:04:05Z",
    )
    page = (folder / "review.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;wall" in page
    # a spreadsheet computes what begins like a formula
    assert pl.read_csv(folder / "ledger.csv")["note"][2] == "'=<b>wall</b>"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("[[cycle]\n", "not TOML"),
        (verdict("2001-01-01T00:00:00Z", ""), "no cycle '2001-01-01T00:00:00Z'"),
        ('[[cycle]]\nid = "x"\ntime = 2026-01-02T03:04:05Z\n', "author"),
        (verdict("nothing", "rejected = true\n"), "rejected"),
    ],
)
def test_verdicts_that_are_wrong_are_one_line(
    driven: tuple[list[Path], Path, Any], folder: Path, text: str, part: str
) -> None:
    logs, machine, _ = driven
    (folder / "verdicts.toml").write_text(text, encoding="utf-8")
    before = (folder / "review.html").read_bytes()
    with pytest.raises(ReviewError, match=r"verdicts\.toml") as fault:
        review_shift(logs, machine, folder, ReviewOptions())
    assert part in str(fault.value)
    assert "\n" not in str(fault.value)
    assert (folder / "review.html").read_bytes() == before


def test_a_second_review_into_the_folder_at_once_is_one_line(
    driven: tuple[list[Path], Path, Any], folder: Path
) -> None:
    logs, machine, _ = driven
    with (folder / ".lock").open("a") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(ReviewError, match="another process is writing a review"):
            review_shift(logs, machine, folder, ReviewOptions())


def test_a_folder_of_other_files_takes_no_review(
    driven: tuple[list[Path], Path, Any], tmp_path: Path
) -> None:
    logs, machine, _ = driven
    (tmp_path / "thesis.txt").touch()
    with pytest.raises(PayscopeError, match=r"thesis\.txt"):
        review_shift(logs, machine, tmp_path, ReviewOptions())


@pytest.mark.heavy
def test_the_review_of_another_shift_is_replaced_only_on_request(
    driven: tuple[list[Path], Path, Any], folder: Path, tmp_path: Path
) -> None:
    logs, machine, _ = driven
    other = tmp_path / "tuesday"
    other.mkdir()
    renamed = Path(shutil.copy(logs[0], other / f"tuesday{logs[0].suffix}"))
    ledger = (folder / "ledger.csv").read_bytes()
    # the same bytes by another name are the same log
    review_shift([renamed], machine, folder, ReviewOptions())
    assert (folder / "ledger.csv").read_bytes() != ledger
    state = json.loads((folder / STATE).read_text())
    for each in state["inputs"]:
        each |= {"name": "monday.bag", "sha256": "0" * 64}
    (folder / STATE).write_text(json.dumps(state))
    with pytest.raises(ReviewError, match=r"holds the review of other logs \(monday\.bag, "):
        review_shift([renamed], machine, folder, ReviewOptions())
    review_shift([renamed], machine, folder, ReviewOptions(replaces_other_shift=True))


@pytest.mark.heavy
@pytest.mark.parametrize(
    "share", [pytest.param(0.5, id="within a chunk"), pytest.param(0.97, id="within the index")]
)
def test_a_bag_that_is_cut_off_is_told_as_a_log_that_breaks_off(
    tmp_path: Path, share: float
) -> None:
    short = {"campaign": {"loads_kg": [0], "runs": 1}}
    (bag,) = simulate_scenario_to_logs(Scenario.model_validate(short), tmp_path / "shift.bag")
    data = bag.read_bytes()
    bag.write_bytes(data[: int(share * len(data))])
    with open_log(bag) as log:
        replayed = run(log, load_machine("cat262c.toml"))
        (torn,) = find_truncated_logs([log], {"/imu/data": []}, replayed.provenance)
        ends_ns = log.topics().filter(pl.col("topic") == "/imu/data")["end_ns"][0]
    assert torn.ends_s == pytest.approx((ends_ns - replayed.provenance.t0_unix_ns) / 1e9)


def _command(logs: list[Path], machine: Path, folder: Path) -> list[str]:
    words = ["review", *map(str, logs), "-m", str(machine), "-o", str(folder)]
    return [sys.executable, "-c", "from payscope import main; main()", *words]


@pytest.mark.heavy
def test_a_review_that_is_killed_leaves_no_half_file_and_the_next_gives_the_same_ledger(
    driven: tuple[list[Path], Path, Any], reviewed: ShiftReview, tmp_path: Path
) -> None:
    logs, machine, _ = driven
    folder = tmp_path / "review"
    command = _command(logs, machine, folder)
    killed = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # the moment at which the outputs are written
    while killed.poll() is None and not any(folder.glob(".payscope-*")):
        time.sleep(0.005)
    time.sleep(0.05)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    shown = {each.name for each in folder.iterdir() if not each.name.startswith(".")}
    assert shown <= OUTPUTS
    if STATE in shown:
        json.loads((folder / STATE).read_text(encoding="utf-8"))
    again = review_shift(logs, machine, folder, ReviewOptions())
    assert again.ledger.equals(reviewed.ledger)
    assert not list(folder.glob(".payscope-*"))


@pytest.mark.slow
def test_ten_reviews_that_are_killed_at_any_moment_leave_no_half_file(
    driven: tuple[list[Path], Path, Any], reviewed: ShiftReview, tmp_path: Path
) -> None:
    logs, machine, _ = driven
    folder = tmp_path / "review"
    command = _command(logs, machine, folder)
    begin = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    whole_s = time.monotonic() - begin
    moments = random.Random(15)
    for _ in range(10):
        for each in OUTPUTS & {path.name for path in folder.iterdir()}:
            (folder / each).unlink()
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as left:
            time.sleep(moments.uniform(0.2, 1.1) * whole_s)
            left.kill()
        shown = {each.name for each in folder.iterdir() if not each.name.startswith(".")}
        assert shown <= OUTPUTS
        with replays_anew():
            again = review_shift(logs, machine, folder, ReviewOptions())
        assert again.ledger.equals(reviewed.ledger)
        assert not list(folder.glob(".payscope-*"))
