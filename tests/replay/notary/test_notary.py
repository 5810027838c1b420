"""`payscope notarise`: append-only, signed, chained; what is done to a list is found."""

import datetime as dt
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from estimators.errors import EvidenceError, OutputError
from recordings.notary.notary_check import CheckedNotaryList, check_untrusted_notary_list
from recordings.notary.notary_list import (
    NotaryEntry,
    NotaryHead,
    NotaryLine,
    encode_notary_lines,
    make_signed_line,
    parse_untrusted_line,
)
from recordings.signatures.keyring import KnownKey, add_key_to_keyring, load_keyring
from recordings.signatures.signing import SigningKey, read_public_key_file, read_signing_key_or_none
from replay.notary.list_file import STATE_VARIABLE
from replay.notary.notarise_folder import LIST_NAME, NotarisedFolder, notarise_folder
from tests.conftest import REPO
from tests.replay.attacker import key_files
from tests.replay.sledge import Payscope, join_to_one_line

LOGS = 6
NOON_S = 1_777_636_800  # 2026-05-01, 12:00 UTC
HOUR_S = 3600
NOW = dt.datetime(2026, 11, 1, tzinfo=dt.UTC)


@pytest.fixture(autouse=True)
def second_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "state"
    monkeypatch.setenv(STATE_VARIABLE, str(folder))
    monkeypatch.setenv("PAYSCOPE_KEYRING", str(tmp_path / "keys.toml"))
    return folder


@pytest.fixture
def keys(tmp_path: Path) -> tuple[Path, Path]:
    return key_files(tmp_path, "recorder")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    for number in range(LOGS):
        record(folder, number)
    return folder


def record(folder: Path, number: int, name: str = "") -> Path:
    """A log of two rows, an hour after the one before; nobody has written to it since."""
    path = folder / (name or f"log-{number}.csv")
    begin = NOON_S + HOUR_S * number
    path.write_text(f"time_s,force_N\n{begin}.0,1.0\n{begin + 60}.0,{number}.0\n")
    os.utime(path, (begin + 61, begin + 61))
    return path


@pytest.fixture
def listed(folder: Path, keys: tuple[Path, Path]) -> NotarisedFolder:
    return notarise_folder(folder, key_file=keys[0], machine_id="sledge-7")


def test_each_finished_log_is_listed_once_in_the_order_of_time(
    folder: Path, keys: tuple[Path, Path], listed: NotarisedFolder
) -> None:
    assert [entry.log for entry in listed.added] == [f"log-{k}.csv" for k in range(LOGS)]
    assert [entry.counter for entry in listed.added] == list(range(1, LOGS + 1))
    first = listed.added[0]
    assert first.files[0].sha256 == hashlib.sha256((folder / "log-0.csv").read_bytes()).hexdigest()
    assert (first.begins, first.ends) == ("2026-05-01T12:00:00Z", "2026-05-01T12:01:00Z")
    again = notarise_folder(folder, key_file=keys[0])
    assert (again.added, again.last) == ((), LOGS)
    record(folder, 9)
    assert [entry.counter for entry in notarise_folder(folder, key_file=keys[0]).added] == [
        LOGS + 1
    ]


def test_a_log_that_is_still_written_to_waits(folder: Path, keys: tuple[Path, Path]) -> None:
    os.utime(folder / "log-3.csv")
    made = notarise_folder(folder, key_file=keys[0])
    assert made.waiting == ("log-3.csv",)
    assert len(made.added) == LOGS - 1


def test_what_is_no_log_is_not_listed(folder: Path, keys: tuple[Path, Path]) -> None:
    (folder / "notes.md").write_text("nothing")
    (folder / "link.csv").symlink_to(folder / "log-0.csv")
    (folder / ".hidden.csv").write_text("x")
    (folder / "inside").mkdir()
    record(folder / "inside", 7)
    bag = folder / "bag"
    bag.mkdir()
    for name in ("metadata.yaml", "bag_0.mcap"):
        (bag / name).write_text("damaged")
        os.utime(bag / name, (NOON_S, NOON_S))
    made = notarise_folder(folder, key_file=keys[0])
    names = {entry.log: len(entry.files) for entry in made.added}
    assert names.pop("bag") == 2
    assert names.pop("inside/log-7.csv") == 1
    assert set(names) == {f"log-{k}.csv" for k in range(LOGS)}


def test_a_log_that_is_changed_after_it_was_listed_is_listed_again(
    folder: Path, keys: tuple[Path, Path], listed: NotarisedFolder
) -> None:
    (folder / "log-2.csv").write_text("time_s,force_N\n1.0,1.0\n2.0,1.0\n")
    os.utime(folder / "log-2.csv", (NOON_S, NOON_S))
    (entry,) = notarise_folder(folder, key_file=keys[0]).added
    assert entry.replaces == 3
    found = check_untrusted_notary_list(listed.path.read_bytes(), NOW.replace(year=2100))
    assert "'log-2.csv' was changed after it had been listed as number 3" in words(found)


def words(found: CheckedNotaryList) -> str:
    return "\n".join(fault.what for fault in found.faults)


def lines_of(path: Path) -> list[NotaryLine]:
    return [parse_untrusted_line(line, "line") for line in path.read_bytes().splitlines()]


# What somebody does to a list who lacks its key -------------------------------------------------


def drop(*numbers: int) -> Callable[[list[bytes]], list[bytes]]:
    return lambda lines: [line for k, line in enumerate(lines) if k not in numbers]


def swap(a: int, b: int) -> Callable[[list[bytes]], list[bytes]]:
    def change(lines: list[bytes]) -> list[bytes]:
        lines[a], lines[b] = lines[b], lines[a]
        return lines

    return change


def replace(number: int, old: bytes, new: bytes) -> Callable[[list[bytes]], list[bytes]]:
    def change(lines: list[bytes]) -> list[bytes]:
        assert old in lines[number]
        lines[number] = lines[number].replace(old, new)
        return lines

    return change


def twice(number: int) -> Callable[[list[bytes]], list[bytes]]:
    return lambda lines: [*lines[: number + 1], *lines[number:]]


Change = Callable[[list[bytes]], list[bytes]]
#: What is done to the lines, and what is said of it.
ATTACKS: dict[str, tuple[Change, str]] = {
    "drop the first": (drop(1), "does not follow|missing"),
    "drop one": (drop(3), "number 3 is missing"),
    "drop two": (drop(3, 4), "numbers 3 to 4 are missing"),
    "drop every second": (drop(2, 4), "number 2 is missing"),
    "drop the head": (drop(0), "first line is not the head"),
    "drop all": (lambda _: [], "first line is not the head"),
    "swap two": (swap(2, 3), "number 3 is not|missing|out of order"),
    "swap first and last": (swap(1, 6), "missing|out of order"),
    "reverse": (lambda lines: [lines[0], *lines[:0:-1]], "out of order"),
    "repeat one": (twice(3), "out of order, or twice"),
    "repeat the head": (twice(0), "second head"),
    "other digest": (replace(2, b'"sha256":"', b'"sha256":"0'), "files.0.sha256|sha256"),
    "other name": (replace(2, b'"log":"log-1', b'"log":"log-9'), "number 2 is not signed"),
    "back-date begin": (replace(2, b"2026-05-01T13:00", b"2026-04-01T13:00"), "not signed"),
    "back-date end": (replace(2, b"2026-05-01T13:01", b"2026-05-01T13:00"), "not signed"),
    "back-date listing": (replace(2, b'"listed":"2', b'"listed":"1'), "number 2 is not signed"),
    "other counter": (replace(2, b'"counter":2', b'"counter":7'), "not signed"),
    "counter 0": (replace(2, b'"counter":2', b'"counter":0'), "line 3"),
    "negative counter": (replace(2, b'"counter":2', b'"counter":-2'), "line 3"),
    "counter as text": (replace(2, b'"counter":2', b'"counter":"2"'), "line 3"),
    "other machine": (replace(0, b'"sledge-7"', b'"sledge-8"'), "number 0 is not signed"),
    "no machine": (replace(0, b'"sledge-7"', b'""'), "number 0 is not signed"),
    "other format": (replace(0, b"payscope-notary/1", b"payscope-notary/2"), "line 1"),
    "replaces": (replace(2, b'"replaces":null', b'"replaces":1'), "not signed"),
    "size": (replace(2, b'"size_bytes":', b'"size_bytes":1'), "not signed"),
    "signature gone": (replace(2, b'"signature":"', b'"signatures":"'), "has no signature"),
    "signature of zeros": (
        lambda lines: [line[:-90] + b"A" * 86 + b'=="}' if k == 2 else line
                       for k, line in enumerate(lines)],
        "line 3|not signed",
    ),
    "a key more": (replace(2, b'{"begins"', b'{"aa":1,"begins"'), "line 3"),
    "spaces": (replace(2, b'{"begins"', b'{ "begins"'), "not in the canonical form"),
    "a name twice": (replace(2, b'{"begins"', b'{"begins":"","begins"'), "appears twice"),
    "no JSON": (lambda lines: [*lines[:2], b"nonsense", *lines[3:]], "not valid JSON"),
    "an empty line": (lambda lines: [*lines[:3], b"", *lines[3:]], "not valid JSON"),
    "null": (lambda lines: [*lines[:3], b"null", *lines[3:]], "has no signature"),
    "a list": (lambda lines: [*lines[:3], b"[]", *lines[3:]], "has no signature"),
    "nested": (lambda lines: [*lines[:3], b"[" * 90_000, *lines[3:]], "nested deeper"),
    "very long": (lambda lines: [*lines[:3], b" " * (2 << 20), *lines[3:]], "has more than"),
    "carriage returns": (
        lambda lines: [line + b"\r" for line in lines],
        "canonical|not valid JSON",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ATTACKS)
def test_what_is_done_to_a_list_without_its_key_is_found(
    name: str, listed: NotarisedFolder, payscope: Payscope
) -> None:
    change, said = ATTACKS[name]
    lines = change(listed.path.read_bytes().splitlines())
    listed.path.write_bytes(b"".join(line + b"\n" for line in lines))
    left = payscope("verify", listed.path)
    assert left.status == 3, left.out
    assert "tampered: notary.jsonl: " in left.out
    assert any(each in left.out for each in said.split("|")), left.out


def resigned(
    listed: NotarisedFolder, key: SigningKey, change: Callable[[int, dict[str, Any]], None]
) -> CheckedNotaryList:
    """The list with other contents, chained and signed anew: what its keeper's clock, or a thief
    of the key, can make."""
    head, *rest = lines_of(listed.path)
    made = [make_signed_line(head.content, key)]
    for line in rest:
        values = line.content.model_dump(mode="json")
        change(values["counter"], values)
        values |= {"head": made[0].line_sha256, "previous": made[-1].line_sha256}
        made.append(make_signed_line(NotaryEntry.model_validate(values), key))
    return check_untrusted_notary_list(encode_notary_lines(made), NOW)


def at(number: int, **values: str) -> Callable[[int, dict[str, Any]], None]:
    def change(counter: int, entry: dict[str, Any]) -> None:
        entry["listed"] = f"2026-06-01T12:00:{counter:02}Z"
        if counter == number:
            entry |= values

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (at(3, listed="2026-05-30T12:00:00Z"), "before number 2, 2026-06-01T12:00:02Z: the clock"),
        (at(3, listed="2026-12-01T00:00:00Z"), "number 3 was listed in the future"),
        (at(3, ends="2026-10-01T12:00:00Z"), "after it was listed, 2026-06-01T12:00:03Z"),
        (at(3, ends="2026-05-01T12:00:30Z"), "number 3 ends before it begins"),
        (
            at(3, begins="2026-04-01T11:00:00Z", ends="2026-04-01T11:01:00Z"),
            "it reached the folder late, or the recorder's clock was set back",
        ),
    ],
)
def test_times_that_cannot_be_are_found_though_they_are_signed(
    listed: NotarisedFolder,
    keys: tuple[Path, Path],
    change: Callable[[int, dict[str, Any]], None],
    said: str,
) -> None:
    key = read_signing_key_or_none(keys[0])
    assert key is not None
    assert said in words(resigned(listed, key, change))
    assert words(resigned(listed, key, at(0))) == ""


def test_a_list_made_anew_with_another_key_is_not_trusted(
    listed: NotarisedFolder, keys: tuple[Path, Path], tmp_path: Path, payscope: Payscope
) -> None:
    other, _ = key_files(tmp_path, "other")
    key = read_signing_key_or_none(other)
    assert key is not None
    head, *rest = lines_of(listed.path)
    assert isinstance(head.content, NotaryHead)
    forged = head.content.model_copy(update={"public_key": key.public_key.base64_text})
    made = [make_signed_line(forged, key)]
    for line in rest:
        values = {"head": made[0].line_sha256, "previous": made[-1].line_sha256}
        made.append(make_signed_line(line.content.model_copy(update=values), key))
    path = tmp_path / "forged.jsonl"
    path.write_bytes(encode_notary_lines(made))
    assert "signed by an unknown key" in payscope("verify", path).out
    assert payscope("verify", path, "--key", keys[1]).status == 3
    assert payscope("verify", path, "--require-signed").status == 5
    assert payscope("verify", listed.path, "--key", keys[1], "--require-signed").status == 0
    add_key_to_keyring(
        load_keyring(), KnownKey(key=read_public_key_file(keys[1]).base64_text, owner="Recorder 7")
    )
    said = payscope("verify", listed.path, "--require-signed")
    assert said.status == 0
    assert "6 logs verified; signed by Recorder 7" in said.out


def test_lines_of_another_list_by_the_same_key_are_found(
    listed: NotarisedFolder, keys: tuple[Path, Path], tmp_path: Path
) -> None:
    other = tmp_path / "other"
    shutil.copytree(listed.path.parent, other)
    (other / LIST_NAME).unlink()
    second = notarise_folder(other, key_file=keys[0], machine_id="sledge-7")
    paths = (listed.path, second.path)
    own, theirs = (path.read_bytes().splitlines(keepends=True) for path in paths)
    for spliced in (
        [*own[:3], *theirs[3:]],
        [*own[:3], theirs[3], *own[4:]],
        [theirs[0], *own[1:]],
        [*own, theirs[-1]],
    ):
        found = check_untrusted_notary_list(b"".join(spliced), NOW.replace(year=2100))
        assert any(fault.forged for fault in found.faults), words(found)
        assert "another list" in words(found)


# What happens to a notary ----------------------------------------------------------------------


def test_wherever_a_line_breaks_off_the_next_pass_goes_on_from_the_last_whole_one(
    folder: Path, keys: tuple[Path, Path], listed: NotarisedFolder, second_place: Path
) -> None:
    """Test: the last line cut after each of its bytes, as a kill or power loss leaves it."""
    whole = listed.path.read_bytes()
    last = whole[:-1].rfind(b"\n") + 1
    (end,) = second_place.iterdir()
    kept = end.read_bytes()
    for cut in (*range(last, len(whole) - 1, 41), len(whole) - 2, len(whole) - 1):
        listed.path.write_bytes(whole[:cut])
        # the second place is written after the line: it knows the line before at most
        end.unlink(missing_ok=True)
        made = notarise_folder(folder, key_file=keys[0])
        assert made.last == LOGS
        assert bool(made.notes) == (cut > last)
        found = check_untrusted_notary_list(listed.path.read_bytes(), NOW.replace(year=2100))
        assert found.faults == []
    end.write_bytes(kept)


def test_a_torn_tail_is_found_by_verify(listed: NotarisedFolder, payscope: Payscope) -> None:
    listed.path.write_bytes(listed.path.read_bytes()[:-40])
    left = payscope("verify", listed.path)
    assert left.status == 5
    assert "incomplete: notary.jsonl: is truncated" in left.out


def test_a_list_that_was_cut_or_taken_away_is_not_gone_on_with(
    folder: Path, keys: tuple[Path, Path], listed: NotarisedFolder
) -> None:
    whole = listed.path.read_bytes().splitlines(keepends=True)
    listed.path.write_bytes(b"".join(whole[:-1]))
    with pytest.raises(
        EvidenceError, match="written up to number 6, so it was truncated or replaced"
    ):
        notarise_folder(folder, key_file=keys[0])
    listed.path.unlink()
    with pytest.raises(EvidenceError, match="so the list was removed"):
        notarise_folder(folder, key_file=keys[0])
    listed.path.write_bytes(b"".join([*whole[:3], *whole[4:]]))
    with pytest.raises(EvidenceError, match="does not hold the digest of the line before"):
        notarise_folder(folder, key_file=keys[0])
    listed.path.write_bytes(b"".join(whole))
    assert notarise_folder(folder, key_file=keys[0]).last == LOGS


def test_a_list_has_one_key_one_machine_and_one_notary(
    folder: Path, keys: tuple[Path, Path], listed: NotarisedFolder, tmp_path: Path
) -> None:
    other, _ = key_files(tmp_path, "other")
    with pytest.raises(EvidenceError, match="is signed with another key"):
        notarise_folder(folder, key_file=other)
    with pytest.raises(EvidenceError, match="is of machine 'sledge-7', not of 'sledge-8'"):
        notarise_folder(folder, key_file=keys[0], machine_id="sledge-8")
    import fcntl

    with listed.path.open("rb+") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(EvidenceError, match="another process is writing this list"):
            notarise_folder(folder, key_file=keys[0])


def test_a_full_disc_leaves_the_list_as_it_was(
    folder: Path, keys: tuple[Path, Path], listed: NotarisedFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(folder, 8)
    before = listed.path.read_bytes()
    write = os.write

    def full(number: int, data: bytes) -> int:
        write(number, data[:50])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("replay.notary.list_file.os.write", full)
    with pytest.raises(OutputError, match="No space left on device"):
        notarise_folder(folder, key_file=keys[0])
    monkeypatch.undo()
    assert listed.path.read_bytes() == before


def test_a_clock_that_was_set_back_is_said_and_found(
    folder: Path, keys: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = time.time_ns
    path = notarise_folder(folder, key_file=keys[0]).path
    record(folder, 8)
    monkeypatch.setattr(time, "time_ns", lambda: real() - 3600 * 10**9)
    made = notarise_folder(folder, key_file=keys[0])
    assert any("the clock was set back" in note for note in made.notes)
    monkeypatch.undo()
    found = check_untrusted_notary_list(path.read_bytes(), dt.datetime.now(dt.UTC))
    assert "number 7 was listed" in words(found)
    assert "the clock was set back" in words(found)


def test_wrong_use_is_one_line(folder: Path, keys: tuple[Path, Path], payscope: Payscope) -> None:
    join_to_one_line(payscope("notarise", folder), "a notary needs a signing key; give --key")
    join_to_one_line(payscope("notarise", folder / "none", "--key", keys[0]), "no such folder")
    join_to_one_line(payscope("notarise", folder, "--key", keys[1]), "recorder.pub.pem")
    (folder / "list").write_text("x\n")
    said = payscope("notarise", folder, "--key", keys[0], "--list", folder / "list")
    join_to_one_line(said, "line 1: is not valid JSON")


def killed_at(folder: Path, key: Path, after_s: float, environment: dict[str, str]) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "from replay.notary.notarise_folder import notarise_folder\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "notarise_folder(Path(sys.argv[1]), key_file=Path(sys.argv[2]))\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", code, str(folder), str(key)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdin is not None
    child.stdout.readline()
    child.stdin.write("\n")
    child.stdin.flush()
    time.sleep(after_s)
    child.send_signal(signal.SIGKILL)
    child.communicate()


@pytest.mark.heavy
def test_a_notary_that_is_killed_loses_and_invents_nothing(
    folder: Path, keys: tuple[Path, Path]
) -> None:
    """Test: kill -9 while it lists. Expected Result: a whole list after the next pass."""
    for number in range(LOGS, 150):
        record(folder, number, f"log-{number}.csv")
    environment = {**os.environ, "PYTHONPATH": str(REPO)}
    for after_s in (0.01, 0.1, 0.25):
        killed_at(folder, keys[0], after_s, environment)
    made = notarise_folder(folder, key_file=keys[0])
    found = check_untrusted_notary_list(made.path.read_bytes(), dt.datetime.now(dt.UTC))
    assert found.faults == []
    assert sorted(entry.log for entry in found.log_entries) == sorted(
        f"log-{number}.csv" for number in range(150)
    )
