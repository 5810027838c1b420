"""Which machine: a sister's log, machine file or evidence is refused wherever evidence is used."""

import shutil
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

import polars as pl
import pyarrow.parquet as pq
import pytest

from analysis.model.machine_body import Body
from benchmarks.fleet_logs import SerialEngine
from estimators.errors import CampaignError, EvidenceError, LogError
from recordings import read_provenance
from recordings.calibration.check_outcomes import BundleOutcome
from replay.calibration.apply_evidence import CalibrationRequest, load_and_verify_calibration
from replay.calibration.calibrate_campaign import CalibrationOutcome, calibrate_from_campaign
from replay.calibration.check_mass import KnownMassOnBoard, write_evidence_of_mass_check
from replay.calibration.verify_bundle import verify_bundle
from replay.fleet.log_sources import list_logs_of_sources
from replay.fleet.machine_setups import NamedFiles, load_fleet, make_setups_of_machine
from replay.fleet.run_fleet import replay_logs_of_fleet
from replay.inputs.machine_identity import find_machine_id_common_to_logs
from replay.logs import open_log
from replay.logs.machine_ids import read_distinct_serial_numbers
from replay.machines.machine_file import load_machine
from replay.pipeline import run
from tests.replay.attacker import Bundle, tampered
from tests.replay.made_evidence import ALIKE, items
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf")

OWN, SISTER = "sledge-7", "sledge-8"
NOON_2026_05_01 = 1777636800.0


def named_log(table: Path, path: Path, metadata: Mapping[str, str]) -> Path:
    """The same table as Parquet, whose metadata may name its machine."""
    columns = pl.read_csv(table).to_arrow()
    pq.write_table(columns.replace_schema_metadata(dict(metadata)), path)
    return path


def campaign_of(folder: Path, *machines: str) -> Path:
    """A campaign of as many logs, each of which names a machine; "" names none."""
    count = len(machines)
    campaign = campaign_folder(
        folder, extra=ALIKE, loads=tuple(range(count)), begin_unix_s=NOON_2026_05_01
    )
    for number, machine in enumerate(machines):
        metadata = {"machine_id": machine} if machine else {}
        named_log(folder / f"load-{number}.csv", folder / f"load-{number}.parquet", metadata)
    campaign.write_text(campaign.read_text().replace(".csv", ".parquet"))
    return campaign


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("machine of evidence")
    campaign_of(folder, OWN, OWN, "")
    named_log(folder / "load-1.csv", folder / "sister.parquet", {"machine_id": SISTER})
    return folder


@pytest.fixture(scope="module")
def made(folder: Path) -> CalibrationOutcome:
    return calibrate_from_campaign(folder / "campaign.toml", folder / "evidence")


@pytest.mark.heavy
def test_evidence_keeps_what_each_log_calls_its_machine(
    made: CalibrationOutcome, folder: Path
) -> None:
    assert [log.machine_id for log in made.document.logs] == [OWN, OWN, ""]
    found = verify_bundle(made.folder, log_folder=folder)
    assert not found.findings, items(found)
    unseen = "\n".join(found.unverifiable_statements)
    assert "load-2.parquet. They do not name theirs" in unseen
    assert "Whether 2 logs whose metadata name this machine were recorded by it" in unseen


def test_a_campaign_of_a_sisters_log_or_machine_file_is_refused(tmp_path: Path) -> None:
    campaign = campaign_of(tmp_path, SISTER)
    with pytest.raises(LogError, match=f"machine '{SISTER}', but machine.id is '{OWN}'"):
        calibrate_from_campaign(campaign, tmp_path / "evidence")
    file = tmp_path / "sledge.toml"
    file.write_text(file.read_text().replace("[machine]", f'[machine]\nid = "{SISTER}"', 1))
    with pytest.raises(CampaignError, match=f"is for machine '{OWN}', but its machine file is for"):
        calibrate_from_campaign(campaign, tmp_path / "evidence")
    assert not (tmp_path / "evidence").exists()


@pytest.mark.heavy
def test_a_sisters_log_is_refused_by_run_sweep_review_and_check(
    made: CalibrationOutcome, folder: Path, tmp_path: Path, payscope: Payscope
) -> None:
    """Test: settings and name are the same. Expected Result: exit 2, and both serial numbers."""
    words = f"its metadata name machine '{SISTER}', but machine.id is '{OWN}'"
    ask = ("-m", folder / "sledge.toml", "--calibration", made.folder)
    log = folder / "sister.parquet"
    join_to_one_line(payscope("run", log, *ask), words)
    over = ("--over", "settings.align.rate_hz=80,100")
    join_to_one_line(payscope("sweep", log, *ask, *over), words)
    join_to_one_line(payscope("review", log, *ask, "-o", tmp_path / "review"), words)
    with pytest.raises(CampaignError, match=f"'{SISTER}', but the campaign is for '{OWN}'|{words}"):
        check_log(log, tmp_path, made.folder)
    # without evidence the log's own word is all there is
    assert payscope("run", log, *ask[:2], "-o", tmp_path / "plain.rrd").status in (0, 1)
    about = read_provenance(tmp_path / "plain.rrd")
    assert (about.logged_machine_id, about.machine["machine"]["id"]) == (SISTER, SISTER)
    said = payscope("show", tmp_path / "plain.rrd", "loads", "--calibration", made.folder)
    join_to_one_line(said, f"belongs to machine '{OWN}', not to '{SISTER}'")


def check_log(log: Path, tmp_path: Path, previous: Path) -> None:
    try:
        write_evidence_of_mass_check(
            log, KnownMassOnBoard(20.0, 0.1, "", None), tmp_path / "check", previous=previous
        )
    except LogError as error:
        raise CampaignError(str(error)) from error


@pytest.mark.heavy
def test_a_sisters_log_is_refused_in_a_fleet_and_the_others_are_not(
    made: CalibrationOutcome, folder: Path, tmp_path: Path
) -> None:
    logs = tmp_path / "sledge"
    logs.mkdir()
    day = {"machine_id": OWN}
    late = pl.read_csv(folder / "load-1.csv").with_columns(pl.col("time_s") + 20 * 86400.0)
    late.write_csv(tmp_path / "late.csv")
    named_log(tmp_path / "late.csv", logs / "own.parquet", day)
    named_log(tmp_path / "late.csv", logs / "other.parquet", {"machine_id": SISTER})
    shutil.copy(folder / "sledge.toml", tmp_path)
    shutil.copytree(made.folder, tmp_path / "evidence")
    (tmp_path / "fleet.toml").write_text(
        '[[machines]]\nlogs = "sledge/*"\nname = "sledge"\nfile = "sledge.toml"\n'
        'calibrations = "evidence"\n'
    )
    fleet = load_fleet(tmp_path / "fleet.toml", ())
    did = replay_logs_of_fleet(
        list_logs_of_sources([str(logs)]), fleet, str(tmp_path / "results"), SerialEngine
    )
    assert did.replayed == 1
    refused = str(did)
    assert "other.parquet" in refused
    assert f"machine '{SISTER}', but machine.id is '{OWN}'" in refused


def test_a_sisters_machine_file_is_refused_though_all_else_is_the_same(
    made: CalibrationOutcome, folder: Path, tmp_path: Path, payscope: Payscope
) -> None:
    file = tmp_path / "sledge.toml"
    text = (folder / "sledge.toml").read_text()
    file.write_text(text.replace("[machine]", f'[machine]\nid = "{SISTER}"', 1))
    words = f"belongs to machine '{OWN}', not to '{SISTER}'"
    for command in (("run",), ("review", "-o", tmp_path / "review")):
        ask = ("-m", file, "--calibration", made.folder)
        join_to_one_line(payscope(command[0], folder / "load-1.parquet", *ask, *command[1:]), words)
    with pytest.raises(EvidenceError, match=words):
        make_setups_of_machine(
            "sledge",
            NamedFiles(str(file), (), (str(made.folder),)),
            is_unfit_evidence_skipped=False,
        )
    # and by its serial number a machine is known under another name
    file.write_text(text.replace('name = "sledge"', f'name = "the red one"\nid = "{OWN}"'))
    held = load_and_verify_calibration(CalibrationRequest(made.folder))
    assert (
        held.list_differing_settings_as_text(
            held.copy_machine_with_calibrated_settings(load_machine(file))
        )
        == ""
    )


@pytest.mark.heavy
def test_a_log_that_does_not_name_its_machine_says_so_beside_the_mass(
    made: CalibrationOutcome, folder: Path, tmp_path: Path, payscope: Payscope
) -> None:
    ask = ("-m", folder / "sledge.toml", "--calibration", made.folder)
    notes: dict[str, str] = {}
    for name in ("load-1", "load-2"):
        recording = tmp_path / f"{name}.rrd"
        assert payscope("run", folder / f"{name}.parquet", *ask, "-o", recording).status == 0
        notes[name] = read_provenance(recording).notes[-1]
    assert f"of machine {OWN}, which the log does not name" in notes["load-2"]
    assert "does not name" not in notes["load-1"]


def in_log(number: int, machine: str) -> Callable[[Bundle], None]:
    def tamper(bundle: Bundle) -> None:
        bundle.evidence["logs"][number]["machine_id"] = machine

    return tamper


def of_sister(bundle: Bundle) -> None:
    bundle.evidence["campaign"]["machine"]["id"] = SISTER


def without_names(bundle: Bundle) -> None:
    for log in bundle.evidence["logs"]:
        log["machine_id"] = ""


@pytest.mark.parametrize(
    ("tamper", "words"),
    [
        (in_log(0, SISTER), f"load-0.parquet: its metadata name machine '{SISTER}'"),
        (of_sister, f"the machine file belongs to machine '{OWN}', but the campaign to '{SISTER}'"),
    ],
)
def test_evidence_that_names_two_machines_is_irreproducible(
    made: CalibrationOutcome, tmp_path: Path, tamper: Callable[[Bundle], None], words: str
) -> None:
    found = verify_bundle(
        tampered(_signed(made.folder, tmp_path), tmp_path / "b", tamper, signed=False)
    )
    assert found.outcome is BundleOutcome.IRREPRODUCIBLE
    assert words in items(found)


def _signed(genuine: Path, tmp_path: Path) -> Path:
    """The same with a statement, which `tampered` takes off again."""
    folder = Path(shutil.copytree(genuine, tmp_path / "signed"))
    (folder / "statement.dsse.json").write_bytes(b"{}")
    return folder


@pytest.mark.heavy
def test_what_touches_no_mass_is_no_difference(folder: Path, made: CalibrationOutcome) -> None:
    """Test: such keys changed. Expected Result: the same loads bit for bit, and no refusal."""
    held = load_and_verify_calibration(CalibrationRequest(made.folder))
    plain = load_machine(folder / "sledge.toml")
    other = load_machine(
        folder / "sledge.toml",
        (
            "machine.timezone=Pacific/Apia",
            f"machine.id={OWN}",
            "machine.empty_mass_day=2026-01-31",
            "settings.planar.threshold_std_com_m=0.01",
        ),
    )
    assert (
        held.list_differing_settings_as_text(held.copy_machine_with_calibrated_settings(other))
        == ""
    )
    with open_log(folder / "load-2.csv") as log:
        frames = [run(log, machine).frames for machine in (plain, other)]
    for name in ("loads", "manoeuvres", "verdict"):
        assert frames[0][name].equals(frames[1][name], null_equal=True)


def test_a_serial_number_that_is_not_given_changes_no_machine_file() -> None:
    assert "id" not in Body.model_validate({"name": "sledge"}).model_dump()
    assert Body.model_validate({"name": "s", "id": "A-1"}).model_dump()["id"] == "A-1"


@pytest.mark.parametrize(
    ("metadata", "known", "told"),
    [
        ({"vehicle.serial-number": "A 1/2"}, None, "A 1/2"),
        ({"lidar_serial": "L-1"}, None, ""),
        ({"machine_id": "3", "vin": "W0L000"}, "W0L000", "W0L000"),
        ({"Machine Serial Number": " X\n9 "}, None, "X 9"),
        ({}, "3", ""),
    ],
)
def test_the_metadata_of_a_log_name_its_machine(
    tmp_path: Path, folder: Path, metadata: dict[str, str], known: str | None, told: str
) -> None:
    with open_log(named_log(folder / "load-0.csv", tmp_path / "a.parquet", metadata)) as log:
        assert find_machine_id_common_to_logs([log], known) == told


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("# Machine ID: A-7", ("A-7",)),
        ("machine_serial;A-7;;", ("A-7",)),
        ('"Vehicle Serial Number","A-7"', ("A-7",)),
        ("# recorded with: A-7", ()),
        ("", ()),
    ],
)
def test_the_lines_above_a_text_table_name_its_machine(
    tmp_path: Path, folder: Path, lines: str, told: tuple[str, ...]
) -> None:
    table = (folder / "load-0.csv").read_text()
    (tmp_path / "a.csv").write_text(f"{lines}\n{table}" if lines else table)
    with open_log(tmp_path / "a.csv") as log:
        assert log.machine_ids() == told


def test_a_bare_database_has_the_metadata_of_its_directory(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    yaml = "version: 9\ncustom_data:\n  machine_id: A-7\n"
    for told in (("A-7",), ()):
        with closing(sqlite3.connect(path)) as database:
            if told:
                database.execute("CREATE TABLE metadata (id INTEGER, metadata TEXT)")
                database.execute("INSERT INTO metadata VALUES (1, ?)", (yaml,))
            else:
                database.execute("DROP TABLE metadata")
            database.commit()
        assert read_distinct_serial_numbers([path]) == told


def test_logs_of_two_machines_are_no_time_line(folder: Path, payscope: Payscope) -> None:
    logs = (folder / "load-0.parquet", folder / "sister.parquet")
    said = payscope("run", *logs, "-m", folder / "sledge.toml")
    join_to_one_line(said, f"machine '{SISTER}', but those of", f"name '{OWN}'")
