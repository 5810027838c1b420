"""Results of a fleet: each once, whole or not at all, and what counts of several."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from analysis.fleet.daily_figures import rank_recordings_by_concern
from analysis.fleet.fleet_tables import TABLES
from benchmarks.fleet_logs import SerialEngine, same_results
from estimators.errors import OutputError
from replay.fleet.gathered_tables import open_results_of_fleet
from replay.fleet.object_store import ObjectStore
from replay.fleet.ray_engine import LostTask

pytestmark = pytest.mark.usefixtures("kept_replays")

Run = Callable[..., Any]


def tree(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Every file: its bytes, and when it was written."""
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


class Refusing(SerialEngine):
    """No task is expected, nor that it is opened."""

    def __enter__(self) -> "Refusing":
        raise AssertionError


def test_every_table_lies_by_machine_and_day(kept: Path) -> None:
    for table in TABLES:
        files = [path.relative_to(kept / table) for path in (kept / table).rglob("*.parquet")]
        assert len(files) == 6
        assert {path.parts[0] for path in files} == {f"machine=unit-0{n}" for n in (1, 2, 3)}
        assert {path.parts[1] for path in files} == {"day=2023-11-14"}
        # as any reader of Parquet takes them
        assert pl.read_parquet(kept / table).height >= (0 if table in ("cycles", "findings") else 6)


def test_a_second_run_replays_nothing_and_changes_no_file(results: Path, run_in: Run) -> None:
    before = tree(results)
    did = run_in(results, engine=Refusing)
    assert (did.replayed, did.up_to_date) == (0, 6)
    assert tree(results) == before


def test_a_log_that_was_moved_or_touched_is_hashed_and_not_replayed_again(
    results: Path, run_in: Run, fleet_folder: Path, tmp_path: Path
) -> None:
    moved = shutil.copytree(fleet_folder / "logs", tmp_path / "elsewhere")
    before = {n: each for n, each in tree(results).items() if n.startswith("results/")}
    did = run_in(results, moved)
    assert (did.replayed, did.up_to_date) == (0, 6)
    assert {n: each for n, each in tree(results).items() if n.startswith("results/")} == before


@pytest.mark.heavy
def test_a_log_that_is_there_twice_has_one_result(
    run_in: Run, fleet_folder: Path, tmp_path: Path
) -> None:
    home = tmp_path / "logs/unit-01"
    home.mkdir(parents=True)
    log = fleet_folder / "logs/unit-01/log_00000.mcap"
    for name in ("one.mcap", "two.mcap"):
        shutil.copy(log, home / name)
    run_in(tmp_path / "results", tmp_path / "logs")
    assert open_results_of_fleet(str(tmp_path / "results")).selected_results.height == 1


def test_a_result_whose_writing_breaks_off_was_never_there(
    run_in: Run, fleet_folder: Path, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At whichever of its objects: the next run makes it, and gives the same bytes."""
    log = fleet_folder / "logs/unit-01/log_00000.mcap"
    write = ObjectStore.write_object
    for last in range(len(TABLES)):
        destination = tmp_path / f"results_{last}"
        written = 0

        def full(self: ObjectStore, name: str, data: bytes, last: int = last) -> None:
            nonlocal written
            if name.endswith(".parquet"):
                if written == last:
                    raise OutputError(f"{name}: no space left")
                written += 1
            write(self, name, data)

        with monkeypatch.context() as patched:
            patched.setattr(ObjectStore, "write_object", full)
            did = run_in(destination, log)
        assert next(iter(did.failed.values())).endswith("no space left")
        assert not (destination / "results").exists()
    did = run_in(destination, log)
    assert did.replayed == 1
    differ = same_results(kept, destination)[1]
    assert all(each.startswith("only in one") for each in differ)


def test_a_log_that_is_none_is_refused_and_costs_nobody_else(
    run_in: Run, fleet_folder: Path, tmp_path: Path
) -> None:
    logs = shutil.copytree(fleet_folder / "logs/unit-01", tmp_path / "logs/unit-01")
    (logs / "broken.mcap").write_bytes(b"no log at all")
    (tmp_path / "logs/stray.mcap").write_bytes(b"neither, and in no machine's folder")
    shutil.copy(fleet_folder / "fleet.toml", tmp_path)
    rules = (tmp_path / "fleet.toml").read_text()
    (tmp_path / "fleet.toml").write_text(rules.replace("{machine}/", "logs/{machine}/"))
    did = run_in(tmp_path / "results", tmp_path / "logs", tmp_path / "fleet.toml")
    assert did.replayed == 2
    assert [Path(source).name for source in did.refused] == ["broken.mcap"]
    assert [Path(source).name for source in did.failed] == ["stray.mcap"]
    assert "no rule in" in str(did.failed)
    again = run_in(
        tmp_path / "results", tmp_path / "logs", tmp_path / "fleet.toml", engine=Refusing
    )
    assert again.refused == did.refused
    found = open_results_of_fleet(str(tmp_path / "results"))
    assert found.selected_results["status"].to_list().count("refused") == 1
    assert json.loads((tmp_path / "results/failed.json").read_text()) == did.failed


def test_a_task_that_the_engine_gives_up_is_listed_and_made_by_the_next_run(
    run_in: Run, tmp_path: Path
) -> None:
    class Losing(SerialEngine):
        def run_tasks(self, function: Any, work: Any) -> Any:
            yield work[0].task, LostTask("its node caught fire")
            yield from super().run_tasks(function, work[1:])

    did = run_in(tmp_path / "results", engine=Losing)
    assert list(did.failed.values()) == ["its node caught fire"]
    assert run_in(tmp_path / "results").replayed == 1
    assert json.loads((tmp_path / "results/failed.json").read_text()) == {}


def test_an_interrupted_run_leaves_done_what_is_done(run_in: Run, tmp_path: Path) -> None:
    class Interrupted(SerialEngine):
        def run_tasks(self, function: Any, work: Any) -> Any:
            yield from super().run_tasks(function, work[:2])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_in(tmp_path / "results", engine=Interrupted)
    did = run_in(tmp_path / "results")
    assert (did.replayed, did.up_to_date) == (4, 2)


@pytest.mark.heavy
def test_other_settings_are_other_results_and_those_of_the_last_run_count(
    results: Path, run_in: Run, fleet_folder: Path
) -> None:
    fleet = fleet_folder / "fleet.toml"
    logs = fleet_folder / "logs/unit-01"
    did = run_in(results, logs, fleet, "settings.gate.threshold_nat=0.9")
    assert did.replayed == 2
    found = open_results_of_fleet(str(results))
    assert found.selected_results.height == 6
    assert (
        found.scan_rows_of_selected_results("loads")
        .select(pl.col("key").n_unique())
        .collect()
        .item()
        == 6
    )
    assert found.scan_rows_of_all_settings("results").collect().height == 8
    # back again: nothing to make, and the first ones count
    assert run_in(results).up_to_date == 6
    assert set(open_results_of_fleet(str(results)).selected_results["basis"]) != set(
        found.selected_results["basis"]
    )


def test_a_node_with_other_software_replays_nothing(
    fleet_folder: Path, run_in: Run, tmp_path: Path
) -> None:
    from dataclasses import replace

    class Other(SerialEngine):
        def run_tasks(self, function: Any, work: Any) -> Any:
            for each in work:
                there = {**each.task.versions, "polars": "0.1"}
                yield each.task, function(replace(each.task, versions=there))

    did = run_in(tmp_path / "results", fleet_folder / "logs/unit-01", engine=Other)
    assert did.replayed == 0
    assert all("its node has polars" in why for why in did.failed.values())


@pytest.mark.heavy
def test_recordings_are_kept_on_request_also_of_results_that_are_there(
    results: Path, run_in: Run, fleet_folder: Path
) -> None:
    log = fleet_folder / "logs/unit-02/log_00001.mcap"
    run_in(results, log, keeps_recordings=True)
    (recording,) = (results / "recordings").rglob("*.rrd")
    from recordings import read_recording

    key = recording.stem
    row = (
        open_results_of_fleet(str(results))
        .selected_results.filter(pl.col("key") == key)
        .row(0, named=True)
    )
    made = read_recording(recording)
    assert made.provenance.fingerprint is not None
    assert made.provenance.fingerprint.results == row["results_fingerprint"]
    assert run_in(results, log, engine=Refusing, keeps_recordings=True).up_to_date == 1


def test_what_is_gathered_is_made_anew_where_it_is_missing_or_old(results: Path) -> None:
    first = open_results_of_fleet(str(results)).scan_rows_of_selected_results("loads").collect()
    shutil.rmtree(results / "gathered")
    assert (
        open_results_of_fleet(str(results))
        .scan_rows_of_selected_results("loads")
        .collect()
        .equals(first)
    )
    gone = next((results / "results/machine=unit-01").rglob("*.parquet"))
    gone.unlink()
    found = open_results_of_fleet(str(results))
    assert found.selected_results.height == 5
    assert gone.stem not in set(found.scan_rows_of_selected_results("loads").collect()["key"])


def test_results_with_former_names_of_checks_have_the_present_ones(results: Path) -> None:
    path = min((results / "results").rglob("*.parquet"))
    row = pl.read_parquet(path).with_columns(
        can_weigh=pl.lit(value=False), failed_checks=pl.lit("r_squared, lag, direction")
    )
    row.write_parquet(path)
    shutil.rmtree(results / "gathered", ignore_errors=True)
    for _ in ("gathered now", "gathered before"):
        found = open_results_of_fleet(str(results))
        (checks,) = found.selected_results.filter(pl.col("key") == path.stem)["failed_checks"]
        assert checks == "r_squared, force_delay_s, coulomb_friction"
        concerns = rank_recordings_by_concern(
            found.selected_results,
            found.scan_rows_of_selected_results("cycles"),
            found.scan_rows_of_selected_results("findings"),
        )
        why = concerns.filter(pl.col("key") == path.stem)["why"][0]
        assert f"cannot weigh: {checks}" in why
