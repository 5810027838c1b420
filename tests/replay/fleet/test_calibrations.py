"""Calibrations of a fleet: by the day of the log, kept for the report, refused where they are."""

import datetime as dt
import shutil
from pathlib import Path

import polars as pl
import pytest

from analysis.fleet.calibration_steps import FleetCalibration
from benchmarks.fleet_logs import SerialEngine
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.fleet.gathered_tables import open_results_of_fleet
from replay.fleet.log_sources import list_logs_of_sources
from replay.fleet.machine_setups import choose_setup_valid_on_day, load_fleet
from replay.fleet.run_fleet import FleetRun, replay_logs_of_fleet
from replay.fleet.write_fleet_page import make_fleet_page
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf")

RULE = """
[[machines]]
logs = "{machine}/load-*.csv"
file = "sledge.toml"
calibrations = "evidence/{machine}/*"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign's logs as those of a machine, two of them its recordings; and its evidence."""
    folder = tmp_path_factory.mktemp("calibrated fleet")
    campaign = campaign_folder(folder / "campaign")
    text = campaign.read_text()
    campaign.write_text(f"{text}\n[method]\nlearn = false\n")
    (folder / "evidence/sledge").mkdir(parents=True)
    calibrate_from_campaign(campaign, folder / "evidence/sledge/first")
    (folder / "sledge").mkdir()
    shutil.copy(folder / "campaign/load-0.csv", folder / "sledge")
    # the other one has a date
    noon_s = dt.datetime(2026, 5, 20, 12, tzinfo=dt.UTC).timestamp()
    dated = pl.read_csv(folder / "campaign/load-1.csv").with_columns(pl.col("time_s") + noon_s)
    dated.write_csv(folder / "sledge/load-1.csv")
    shutil.copy(folder / "campaign/sledge.toml", folder)
    (folder / "fleet.toml").write_text(RULE)
    return folder


def run(folder: Path, destination: Path, *overrides: str) -> FleetRun:
    fleet = load_fleet(folder / "fleet.toml", overrides)
    return replay_logs_of_fleet(
        list_logs_of_sources([str(folder / "sledge")]), fleet, str(destination), SerialEngine
    )


def test_the_setup_is_that_of_the_latest_calibration_that_holds_on_the_day(folder: Path) -> None:
    setups = load_fleet(folder / "fleet.toml").list_setups_of_log(str(folder / "sledge/load-0.csv"))
    by = setups[0].by
    assert by is not None
    first, last = setups[0].first, by.document.expires
    for day, calibrated in (
        (first, True),
        (last, True),
        (first - dt.timedelta(days=1), False),
        (last + dt.timedelta(days=1), False),
        (None, False),
    ):
        assert (choose_setup_valid_on_day(setups, day).by is not None) == calibrated
    assert setups[0].basis != setups[1].basis


@pytest.mark.heavy
def test_calibrations_in_use_are_kept_for_the_report(folder: Path, tmp_path: Path) -> None:
    did = run(folder, tmp_path / "results")
    assert did.failed == {}
    results = open_results_of_fleet(str(tmp_path / "results"))
    page = make_fleet_page(results, "dest", "fleet")
    (kept,) = page.calibrations
    assert isinstance(kept, FleetCalibration)
    assert (kept.machine, kept.method) == ("sledge", "joint_mass")
    assert page.changes == []
    # of a log without a date no calibration holds
    used = dict(results.selected_results.select("day", "calibration").iter_rows())
    assert used == {"undated": "", "2026-05-20": kept.id}
    loads = (
        results.scan_rows_of_selected_results("loads")
        .filter(pl.col("day") == "2026-05-20")
        .collect()
    )
    assert (loads["calibrated_kg"].is_not_null() | (loads["calibrated_reason"] != "")).all()
    assert results.scan_rows_of_selected_results("loads").collect()["calibrated_kg"].count() > 0


def test_evidence_of_other_settings_is_a_fault_of_its_logs_and_left_out_of_a_what_if(
    folder: Path, tmp_path: Path
) -> None:
    from replay.fleet.machine_setups import NamedFiles, make_setups_of_machine

    override = "settings.gate.threshold_nat=0.9"
    did = run(folder, tmp_path / "results", override)
    assert len(did.failed) == 2
    assert all("was made with other settings" in why for why in did.failed.values())
    files = NamedFiles(
        str(folder / "sledge.toml"), (override,), (str(folder / "evidence/sledge/first"),)
    )
    (plain,) = make_setups_of_machine("sledge", files, is_unfit_evidence_skipped=True)
    assert plain.by is None
