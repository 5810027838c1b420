"""Logs that are decoded once, side by side, and kept until they change."""

import shutil
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from estimators.errors import LogError, OutputError
from replay import load_machine, open_log
from replay.inputs import decode_cache as decoding
from replay.inputs.channel_inputs import read_channel_fields_and_losses
from replay.inputs.decode_cache import decode_logs_in_parallel
from tests.replay.shift_review import shift_folder


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path, dict[str, Any]]:
    return shift_folder(tmp_path_factory.mktemp("driven"))


@pytest.fixture(params=[False, True], ids=["here", "by processes"])
def side_by_side(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param:
        monkeypatch.setattr(decoding, "_WORTH_A_PROCESS", 0)


def entries(folder: Path) -> dict[str, int]:
    return {each.name: each.stat().st_ino for each in folder.iterdir()}


@pytest.mark.heavy
@pytest.mark.usefixtures("side_by_side")
def test_what_was_decoded_is_what_the_logs_hold(driven: Any, tmp_path: Path) -> None:
    paths, machine_file, _ = driven
    machine = load_machine(machine_file)
    logs = [open_log(path) for path in paths]
    told: list[int] = []
    raw, losses = read_channel_fields_and_losses(
        decode_logs_in_parallel(logs, machine, tmp_path / "kept", told.append), machine
    )
    expected, lost = read_channel_fields_and_losses([open_log(path) for path in paths], machine)
    assert list(raw) == list(expected)
    assert all(raw[topic].equals(expected[topic]) for topic in expected)
    assert [raw[topic].schema for topic in raw] == [expected[t].schema for t in expected]
    assert losses == lost  # one of them is torn
    assert losses
    assert told == [0, 1, 2]


@pytest.mark.heavy
def test_a_log_that_has_not_changed_is_not_decoded_again(driven: Any, tmp_path: Path) -> None:
    paths, machine_file, _ = driven
    machine, kept = load_machine(machine_file), tmp_path / "kept"
    decode_logs_in_parallel([open_log(path) for path in paths], machine, kept)
    before = entries(kept)
    # what a process left that was killed
    (kept / ".begun-0-1").mkdir()
    changed = Path(shutil.copy(paths[0], tmp_path))
    with changed.open("ab") as stream:
        stream.write(b"\0")
    told: list[int] = []
    decode_logs_in_parallel([open_log(changed), open_log(paths[1])], machine, kept, told.append)
    after = entries(kept)
    assert told == [1, 2]
    assert len(after) == 2
    assert len(set(before.items()) & set(after.items())) == 1
    other = load_machine(machine_file, ['channels.boom_rad.field="velocity[boom]"'])
    decode_logs_in_parallel([open_log(paths[1])], other, kept)
    assert not set(entries(kept)) & set(after)


@pytest.mark.heavy
@pytest.mark.usefixtures("side_by_side")
def test_a_field_that_no_message_has_is_one_line_and_leaves_nothing(
    driven: Any, tmp_path: Path
) -> None:
    paths, machine_file, _ = driven
    machine = load_machine(machine_file, ['channels.boom_rad.field="angle"'])
    with pytest.raises(LogError, match="no field 'angle'") as caught:
        decode_logs_in_parallel([open_log(path) for path in paths], machine, tmp_path / "kept")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "kept").exists() or not entries(tmp_path / "kept")


def test_a_folder_that_cannot_be_written_is_one_line(driven: Any, tmp_path: Path) -> None:
    paths, machine_file, _ = driven
    (tmp_path / "kept").write_text("a file")
    with pytest.raises(OutputError, match="cannot be written"):
        decode_logs_in_parallel([open_log(paths[0])], load_machine(machine_file), tmp_path / "kept")


def test_times_and_fields_that_were_not_decoded_come_from_the_log(
    driven: Any, tmp_path: Path
) -> None:
    paths, machine_file, _ = driven
    machine = load_machine(machine_file)
    log = open_log(paths[0])
    (kept,) = decode_logs_in_parallel([log], machine, tmp_path / "kept")
    assert kept.topics().equals(log.topics())
    assert kept.digests == log.digests
    row = log.topics().row(0, named=True)
    middle = (row["start_ns"] + row["end_ns"]) // 2
    for topic, field in (("/boom/angles", "position[boom]"), ("/boom/angles", "velocity[boom]")):
        part = kept.read(topic, [field], start_ns=middle, end_ns=middle + 10**9)
        assert part.equals(log.read(topic, [field], start_ns=middle, end_ns=middle + 10**9))
    with pytest.raises(LogError, match="no topic"):
        kept.read("/boom", ["angle"])


def test_a_disk_that_fills_up_under_it_is_said(
    driven: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths, machine_file, _ = driven

    def fill_up(*_: object, **__: object) -> None:
        raise OSError("No space left on device (os error 28)")  # as polars says it

    monkeypatch.setattr(pl.DataFrame, "write_ipc", fill_up)
    with pytest.raises(OutputError, match=r"kept: cannot be written \(No space left on device"):
        decode_logs_in_parallel([open_log(paths[0])], load_machine(machine_file), tmp_path / "kept")
