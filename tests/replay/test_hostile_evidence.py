"""Bundles made to harm whoever checks them: nothing is run, followed, or read beyond its bounds."""

import json
import os
import pickle
import shutil
import sys
from pathlib import Path

import pytest

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import (
    EVIDENCE,
    READINGS,
    REPORT,
    STATEMENT,
    SUMS,
    format_sha256sums,
)
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.untrusted_files import UntrustedTable, read_untrusted_tables
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.calibration.verify_bundle import Verification, verify_bundle
from tests.replay.attack_list import JSON_FORMS, OUTSIDE
from tests.replay.attacker import Bundle, tampered
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays")


@pytest.fixture(scope="module")
def genuine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    calibrate_from_campaign(campaign_folder(folder / "campaign"), folder / "evidence")
    return folder / "evidence"


def changed(genuine: Path, tmp_path: Path, name: str, data: bytes) -> Verification:
    folder = Path(shutil.copytree(genuine, tmp_path / "b"))
    (folder / name).write_bytes(data)
    return verify_bundle(folder)


def findings_text(found: Verification) -> str:
    return "\n".join(map(str, found.findings))


@pytest.mark.parametrize(("_", "data", "what"), JSON_FORMS, ids=[name for name, *_ in JSON_FORMS])
def test_json_beyond_its_bounds_is_refused(
    genuine: Path, tmp_path: Path, _: str, data: bytes, what: str
) -> None:
    found = changed(genuine, tmp_path, EVIDENCE, data)
    assert found.outcome is BundleOutcome.TAMPERED
    assert what in findings_text(found)


def test_the_statement_is_read_with_the_same_care(genuine: Path, tmp_path: Path) -> None:
    for number, data in enumerate(
        (
            b"[" * 100_000,
            b"{}",
            b'{"payload":"","payloadType":"x","signatures":[]}',
            b'{"payload":1,"payloadType":"application/vnd.in-toto+json","signatures":[1]}',
        )
    ):
        place = tmp_path / str(number)
        place.mkdir()
        assert STATEMENT in findings_text(changed(genuine, place, STATEMENT, data))


@pytest.mark.parametrize("line", OUTSIDE)
def test_names_that_lead_outside_are_refused(genuine: Path, tmp_path: Path, line: str) -> None:
    sums = (genuine / SUMS).read_bytes() + line.encode()
    found = changed(genuine, tmp_path, SUMS, sums)
    assert "is not the digest of a file of this bundle" in findings_text(found)


def test_no_link_is_followed(genuine: Path, tmp_path: Path) -> None:
    for name in (EVIDENCE, REPORT, READINGS, SUMS):
        folder = Path(shutil.copytree(genuine, tmp_path / name))
        (folder / name).unlink()
        (folder / name).symlink_to(genuine / name)
        found = verify_bundle(folder)
        assert found.outcome is BundleOutcome.TAMPERED
        assert f"{name}: is a link" in findings_text(found)
    folder = Path(shutil.copytree(genuine, tmp_path / "runs-link"))
    (folder / "runs").symlink_to("/etc")
    assert "runs: is a link" in findings_text(verify_bundle(folder))


def test_a_pipe_is_not_waited_for(genuine: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(genuine, tmp_path / "b"))
    (folder / REPORT).unlink()
    os.mkfifo(folder / REPORT)
    assert "is not a regular file" in findings_text(verify_bundle(folder))


def test_a_file_too_large_is_not_held(genuine: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(genuine, tmp_path / "b"))
    with (folder / REPORT).open("wb") as file:
        file.truncate(40 << 20)
    assert "has more than" in findings_text(verify_bundle(folder))


def test_more_entries_than_any_bundle_are_refused(tmp_path: Path, genuine: Path) -> None:
    folder = Path(shutil.copytree(genuine, tmp_path / "b"))
    for number in range(4200):
        (folder / f"{number}.txt").touch()
    with pytest.raises(EvidenceError, match="more than 4096 entries"):
        verify_bundle(folder)


@pytest.mark.skipif(sys.platform == "darwin", reason="file names there are UTF-8")
def test_a_name_that_is_not_utf_8_is_a_finding_in_json_too(
    genuine: Path, tmp_path: Path, payscope: Payscope
) -> None:
    folder = Path(shutil.copytree(genuine, tmp_path / "b"))
    Path(os.fsdecode(os.fsencode(folder) + b"/\xff\xfe")).write_text("x")
    said = payscope("verify", folder, "--json")
    assert said.status == BundleOutcome.TAMPERED
    (finding,) = json.loads(said.out)["findings"]
    assert os.fsencode(finding["item"]) == b"\xff\xfe"


def test_a_folder_without_evidence_is_bad_input(payscope: Payscope, tmp_path: Path) -> None:
    (tmp_path / "note.txt").touch()
    join_to_one_line(payscope("verify", tmp_path), "no evidence in this folder")
    join_to_one_line(payscope("verify", tmp_path / "none"), "no such folder")


def test_tables_are_read_by_another_process_that_may_die() -> None:
    import io

    import polars as pl
    import pyarrow as pa
    import pyarrow.parquet as pq

    from analysis.calibration.campaign.campaign_readings import READINGS as COLUMNS
    from recordings.calibration.untrusted_files import encode_uncompressed_parquet_table

    row = dict.fromkeys(COLUMNS, None) | {"run_id": "a", "reading": 1, "used": False}
    frame = pl.DataFrame([row], schema=COLUMNS)
    data = encode_uncompressed_parquet_table(frame)
    (back,) = read_untrusted_tables([UntrustedTable(data, COLUMNS)])
    assert isinstance(back, pl.DataFrame)
    assert back.equals(frame)
    bomb = io.BytesIO()
    pq.write_table(pa.table({"run_id": ["x" * 1000] * 1000}), bomb, compression="zstd")
    found = read_untrusted_tables(
        [
            UntrustedTable(data[:200] + bytes([data[200] ^ 255]) + data[201:], COLUMNS),
            UntrustedTable(bomb.getvalue(), {"run_id": pl.String}),
            UntrustedTable(data, {"run_id": pl.String}),
            UntrustedTable(b"PAR1" * 100, COLUMNS),
            UntrustedTable(pickle.dumps([1]), COLUMNS),
        ]
    )
    assert all(isinstance(each, str) for each in found[1:]), found
    assert found[1] == "is compressed or encoded, which a table of a bundle never is"
    assert found[2] == "has other columns than such a table"


@pytest.mark.slow
def test_no_flipped_byte_of_a_table_ends_the_check(genuine: Path) -> None:
    from analysis.calibration.campaign.campaign_readings import READINGS as COLUMNS

    whole = (genuine / READINGS).read_bytes()
    for first in range(0, len(whole), 64):
        tables: list[UntrustedTable] = []
        for place in range(first, min(first + 64, len(whole)), 4):
            data = bytearray(whole)
            data[place] ^= 1 << place % 8
            tables.append(UntrustedTable(bytes(data), COLUMNS))
        assert len(read_untrusted_tables(tables)) == len(tables)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("campaign", "masses", 0, "value_kg"), 1e-300),
        (("calibration", "c1_1"), 0.0),
        (("calibration", "range_kg"), [1e300, -1e300]),
        (("calibration", "centre_kg"), 1e308),
        (("calibration", "budget_at"), [0.0, 0]),
        (("calibration", "points"), []),
        (("calibration", "components"), []),
        (("calibration", "budget"), []),
        (("references",), [{"load_id": "x", "reference_kg": 1, "u_kg": 1}]),
        (("reference_covariance_kg2",), []),
        (("machine", "machine", "empty_mass_u_kg"), None),
        (("campaign", "campaign", "title"), "<script>alert(1)</script>\u202e"),
    ],
)
def test_numbers_that_break_a_step_are_findings_and_no_traceback(
    genuine: Path, tmp_path: Path, place: tuple[str | int, ...], value: object
) -> None:
    def tamper(bundle: Bundle) -> None:
        inside = bundle.evidence
        for name in place[:-1]:
            inside = inside[name]  # pyright: ignore
        inside[place[-1]] = value  # pyright: ignore

    folder = Path(shutil.copytree(genuine, tmp_path / "b"))
    evidence = json.loads((folder / EVIDENCE).read_bytes())
    bundle = Bundle(folder, evidence, None, None)  # pyright: ignore
    tamper(bundle)
    from recordings.signatures.canonical_json import encode_canonical_json

    (folder / EVIDENCE).write_bytes(encode_canonical_json(evidence))
    found = verify_bundle(folder)
    assert found.outcome is BundleOutcome.TAMPERED
    assert all(finding.item for finding in found.findings)


def test_what_a_log_or_a_name_says_is_text_in_the_report(genuine: Path, tmp_path: Path) -> None:
    nasty = "</td><script>alert('x')</script><img src=x onerror=y>"

    def tamper(bundle: Bundle) -> None:
        bundle.evidence["campaign"]["campaign"]["title"] = nasty
        bundle.evidence["campaign"]["campaign"]["remark"] = nasty
        bundle.evidence["campaign"]["machine"]["parts"][nasty] = nasty
        bundle.evidence["logs"][0]["notes"] = [nasty]

    folder = tampered(_signed(genuine, tmp_path), tmp_path / "b", tamper, signed=False)
    page = (folder / REPORT).read_text(encoding="utf-8")
    assert "&lt;script&gt;" in page
    assert "<script" not in page
    assert "<img" not in page
    assert not verify_bundle(folder).findings


def _signed(genuine: Path, tmp_path: Path) -> Path:
    """The same with a statement, which `tampered` takes off again."""
    folder = Path(shutil.copytree(genuine, tmp_path / "signed"))
    (folder / STATEMENT).write_bytes(b"{}")
    assert format_sha256sums({}) == ""
    return folder
