"""`verify --logs` compares all that is at hand: what evidence keeps of logs, recordings, the PDF.

Here whoever changed the evidence made everything else anew, and no key is asked for."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from analysis.calibration.campaign.campaign_readings import make_run_changes_per_learnt_mean_u
from analysis.calibration.line.calibration import StatedPart
from analysis.calibration.line.shared_errors import RunResponse
from recordings import read_recording
from recordings.calibration.bundle_folder import (
    PDF,
    POINTS,
    READINGS,
    RECORDING,
    SUMS,
    format_sha256sums,
    list_bundle_files_and_faults,
    read_bundle_file,
)
from recordings.calibration.calibration_recording import (
    make_run_of_calibration,
    write_calibration_recording,
)
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.evidence_document import parse_untrusted_evidence
from recordings.calibration.untrusted_files import (
    collect_table_heads,
    compare_words_of_pdf_with_html,
    describe_first_difference,
    join_words_without_page_heads,
)
from recordings.rrd.writer import write_recording
from replay.calibration import calibrate_campaign, campaign_runs
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.calibration.verify_bundle import verify_bundle
from tests.replay.attacker import Bundle, tampered
from tests.replay.former_checks import former_list, run_with_former_names
from tests.replay.made_evidence import ALIKE, items
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays")

TAMPERED, IRREPRODUCIBLE = BundleOutcome.TAMPERED, BundleOutcome.IRREPRODUCIBLE


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Unsigned evidence with the recordings of its runs; its logs lie in `logs` beside it."""
    folder = tmp_path_factory.mktemp("compared")
    campaign = campaign_folder(folder / "logs", extra=ALIKE, loads=(0, 1, 2))
    calibrate_from_campaign(campaign, folder / "evidence", keeps_recordings=True)
    return folder / "evidence"


@pytest.fixture(scope="module")
def bundle(printed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same without its PDF, whose words take longer to read than all else to compare."""
    folder = Path(shutil.copytree(printed.parent, tmp_path_factory.mktemp("without") / "c"))
    (folder / "evidence" / PDF).unlink(missing_ok=True)
    digested(folder / "evidence")
    (folder / "evidence" / "statement.dsse.json").write_bytes(b"{}")  # `tampered` takes it off
    return folder / "evidence"


def changed(bundle: Path, tmp_path: Path, tamper: Callable[[Bundle], None]) -> Path:
    folder = tampered(bundle, tmp_path / "b", tamper, signed=False)
    document = parse_untrusted_evidence((folder / "evidence.json").read_bytes(), "evidence.json")
    (folder / RECORDING).unlink()
    tables = (pl.read_parquet(folder / name) for name in (READINGS, POINTS))
    write_calibration_recording(folder, document, *tables)
    return digested(folder)


def digested(folder: Path) -> Path:
    names, _ = list_bundle_files_and_faults(folder)
    digests = {name: read_bundle_file(folder, name).sha256 for name in names if name != SUMS}
    (folder / SUMS).write_text(format_sha256sums(digests))
    return folder


def in_logs(bundle: Bundle) -> None:
    """Another lie of each log, of everything that is kept of it."""
    first, second, third = bundle.evidence["logs"]
    first["begins"] = "7.000 s of the log's own clock"
    first["duration_s"] += 0.5
    first["topics"][0]["messages"] += 1
    second["topics"][0]["stamped_by"] = "header"
    second["losses"] = ["load-1.csv: a gap that is not there"]
    second["notes"] = ["weighed by hand"]
    third["speed_range_m_s"] = [-1.0, 9.0]
    third["files"][0]["size_bytes"] += 1
    third["machine_id"] = "sledge-7"


@pytest.mark.heavy
@pytest.mark.usefixtures("readers_in_this_process")
def test_every_lie_about_a_log_is_found_by_its_replay(bundle: Path, tmp_path: Path) -> None:
    folder = changed(bundle, tmp_path, in_logs)
    assert not verify_bundle(folder).findings
    found = verify_bundle(folder, log_folder=bundle.with_name("logs"))
    said = items(found)
    assert IRREPRODUCIBLE in {each.outcome for each in found.findings}
    for place, words in (
        ("load-0.csv: begins", "its start time differs: 7.000 s"),
        ("load-0.csv: duration_s", "its duration differs"),
        ("load-0.csv: topics", "counts of messages or their stamps differ"),
        ("load-1.csv: topics", "stamped_by='header'"),
        ("load-1.csv: losses", "a gap that is not there in the evidence, none in the replay"),
        ("load-1.csv: notes", "other notes: weighed by hand in the evidence, none in the replay"),
        ("load-2.csv: speed_range_m_s", "-1.0; 9.0 in the evidence"),
        ("load-2.csv: files", "the files differ"),
        ("load-2.csv: machine_id", "its metadata name another machine: sledge-7 in the evidence"),
    ):
        assert f"{place}: " in said
        assert words in said


@pytest.mark.heavy
@pytest.mark.usefixtures("readers_in_this_process", "without_pdf")
def test_what_later_intervals_depend_on_is_compared_with_the_replays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who has the key and changes payscope itself makes evidence that agrees with itself."""
    campaign = campaign_folder(tmp_path / "logs")
    machine = tmp_path / "logs" / "sledge.toml"
    machine.write_text(
        machine.read_text().replace("[log]", "force_gain_u = 0.01\nforce_share_u = 0.01\n[log]")
    )
    honest, forged = tmp_path / "honest", tmp_path / "forged"
    calibrate_from_campaign(campaign, honest)
    assert not verify_bundle(honest, log_folder=tmp_path / "logs").findings
    with monkeypatch.context() as patched:
        patched.setattr(calibrate_campaign, "list_stated_uncertainties_of_force_scale", no_part)
        patched.setattr(campaign_runs, "make_run_changes_per_learnt_mean_u", no_response)
        calibrate_from_campaign(campaign, forged)
    assert not verify_bundle(forged).findings
    found = verify_bundle(forged, log_folder=tmp_path / "logs")
    said = items(found)
    assert {each.outcome for each in found.findings} == {IRREPRODUCIBLE}
    assert "options.stated: force gain: the replay gives a different uncertainty" in said
    assert "learnt.responses: run 'run-0', const: the replay gives a different response" in said


def no_part(*_: object) -> tuple[StatedPart, ...]:
    return ()


def no_response(*given: Any) -> tuple[RunResponse, ...]:
    return tuple(
        each.model_copy(update={"response_kg": 0.0})
        for each in make_run_changes_per_learnt_mean_u(*given)
    )


@pytest.mark.heavy
@pytest.mark.usefixtures("readers_in_this_process")
def test_untouched_evidence_holds_and_what_is_not_compared_is_listed(printed: Path) -> None:
    found = verify_bundle(printed, log_folder=printed.with_name("logs"))
    assert not found.findings, items(found)
    done, unseen = "\n".join(found.checks_made), "\n".join(found.unverifiable_statements)
    assert "the frames of each run's recording, by their fingerprint" in done
    assert "the frames of calibration.rrd, recomputed" in done
    assert "topics, counts, stamps, losses, notes, speeds and verdict of each log" in done
    assert "What a viewer shows of a recording" in unseen
    assert "people, place, conditions, sensors and parts" in unseen
    assert (f"the words of {PDF}" in done) != (f"Whether {PDF} has the same words as" in unseen)


@pytest.mark.heavy
@pytest.mark.usefixtures("readers_in_this_process")
def test_evidence_with_former_names_of_checks_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "weasyprint", None)  # no PDF
    campaign = campaign_folder(tmp_path / "logs", extra=ALIKE)
    log = tmp_path / "logs" / "load-3.csv"
    late = pl.read_csv(log).with_columns(pl.col("force_N").shift(25, fill_value=0.0))
    late.write_csv(log)
    calibrate_from_campaign(campaign, tmp_path / "evidence", keeps_recordings=True)
    (tmp_path / "evidence" / "statement.dsse.json").write_bytes(b"{}")

    def name_as_before(bundle: Bundle) -> None:
        for each in bundle.evidence["logs"]:
            each["failed_checks"] = [former_list(name) for name in each["failed_checks"]]
            path = bundle.folder / each["recording"]
            run = run_with_former_names(read_recording(path))
            path.unlink()
            write_recording(run, path)
            assert run.provenance.fingerprint is not None
            each["results_fingerprint"] = run.provenance.fingerprint.results
        assert "lag" in bundle.evidence["logs"][3]["failed_checks"]
        for number, row in enumerate(bundle.readings.to_dicts()):
            before, mark, checks = row["reason"].partition("cannot weigh: ")
            bundle.reading(number, reason=before + mark + former_list(checks))
        assert bundle.readings["reason"].str.contains(r"\blag\b").any()

    folder = changed(tmp_path / "evidence", tmp_path, name_as_before)
    found = verify_bundle(folder, log_folder=tmp_path / "logs")
    assert not found.findings, items(found)


def exchanged(bundle: Path, tmp_path: Path, name: str, write: Callable[[Path], object]) -> Path:
    folder = changed(bundle, tmp_path, lambda _: None)
    (folder / name).unlink()
    write(folder / name)
    return digested(folder)


@pytest.mark.heavy
def test_a_recording_of_another_run_is_found_by_its_fingerprint(
    bundle: Path, tmp_path: Path
) -> None:
    first, second = sorted((bundle / "runs").iterdir())[:2]
    name = f"runs/{first.name}"
    folder = exchanged(bundle, tmp_path, name, lambda path: shutil.copy(second, path))
    found = verify_bundle(folder)
    assert found.outcome is TAMPERED
    assert f"{name}: differs in its files from the replay of load-0.csv" in items(found)
    assert f"{name}: differs in its frames from the replay of load-0.csv" in items(found)


@pytest.mark.heavy
def test_a_recording_with_one_number_changed_or_damaged_is_found(
    bundle: Path, tmp_path: Path
) -> None:
    from dataclasses import replace

    first, second = sorted((bundle / "runs").iterdir())[:2]
    run = read_recording(first)
    loads = run.frames["loads"].with_columns(pl.col("mass_kg") + 1e-9)
    other = replace(run, frames={**run.frames, "loads": loads})

    def write(path: Path) -> None:
        write_recording(other, path)
        # and the other one breaks off
        torn = path.with_name(second.name)
        torn.write_bytes(torn.read_bytes()[:5000])

    found = verify_bundle(exchanged(bundle, tmp_path, f"runs/{first.name}", write))
    assert found.outcome is TAMPERED
    assert f"runs/{first.name}: differs in its frames" in items(found)
    torn = f"runs/{second.name}: cannot be read: damaged or not finished (its end is missing); ask"
    assert torn in items(found)


@pytest.mark.heavy
@pytest.mark.usefixtures("readers_in_this_process")
def test_the_recording_of_the_calibration_is_made_anew_and_compared(
    bundle: Path, tmp_path: Path
) -> None:
    document = parse_untrusted_evidence((bundle / "evidence.json").read_bytes(), "evidence.json")
    readings, points = (pl.read_parquet(bundle / name) for name in (READINGS, POINTS))
    forged = make_run_of_calibration(
        document, readings, points.with_columns(pl.col("mean_kg") + 5.0)
    )
    folder = exchanged(bundle, tmp_path, RECORDING, lambda path: write_recording(forged, path))
    assert any(
        "calibration.rrd and report.pdf show" in each
        for each in verify_bundle(folder).unverifiable_statements
    )
    found = verify_bundle(folder, log_folder=bundle.with_name("logs"))
    assert found.outcome is TAMPERED
    assert "calibration.rrd: differs in its frames points from the evidence" in items(found)


@pytest.mark.heavy
def test_a_pdf_is_compared_by_its_words(printed: Path, tmp_path: Path) -> None:
    weasyprint = pytest.importorskip("weasyprint", exc_type=ImportError)
    pytest.importorskip("pypdf")
    html = (printed / "report.html").read_text(encoding="utf-8")
    alpha = html.partition("<dt>α</dt>")[2].partition("<dd>")[2][:6]
    forged = html.replace(alpha, "1.5000")
    path = tmp_path / PDF
    weasyprint.HTML(string=forged).write_pdf(path)
    fault, why = compare_words_of_pdf_with_html(
        tmp_path, read_bundle_file(tmp_path, PDF).sha256, html
    )
    assert why == ""
    assert "1.5000" in fault
    assert alpha in fault
    own = read_bundle_file(printed, PDF).sha256
    assert compare_words_of_pdf_with_html(printed, own, html) == ("", "")
    path.write_bytes((printed / PDF).read_bytes() + b"% hi\n")
    fault, _ = compare_words_of_pdf_with_html(
        tmp_path, read_bundle_file(tmp_path, PDF).sha256, html
    )
    assert "bytes after its end" in fault
    path.write_bytes(path.read_bytes()[:500])
    assert (
        "cannot be read"
        in compare_words_of_pdf_with_html(tmp_path, read_bundle_file(tmp_path, PDF).sha256, html)[0]
    )


def test_heads_that_a_page_break_repeats_are_no_difference() -> None:
    html = "<table><thead><tr><th>run</th><th>mass kg</th></tr></thead><tr><td>1</td></tr></table>"
    heads = collect_table_heads(html)
    assert heads == {"runmasskg"}
    once, twice = (
        ["run", "mass", "kg", "1", "2"],
        ["run", "mass", "kg", "1", "•", "run", "mass", "kg", "2"],
    )
    assert (
        describe_first_difference(
            join_words_without_page_heads(once, heads),
            join_words_without_page_heads(twice, heads),
        )
        == ""
    )
    assert "12" in describe_first_difference(
        join_words_without_page_heads(once, heads),
        join_words_without_page_heads(["run", "mass", "kg", "1"], heads),
    )
