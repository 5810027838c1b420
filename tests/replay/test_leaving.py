"""How the command line leaves: a closed pipe, a full disk, a signal to end."""

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import payscope
from recordings import write_recording
from recordings.report.atomic_output import require_writable_output
from replay import load_machine, open_log, run
from replay.commands import cli
from replay.machines.machine_file import find_time_axis_of_machine
from tests.replay.sledge import MACHINE, sledge
from tests.twins import mark_slow_after

SCRIPT = Path(sys.executable).with_name("payscope")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording that is only read."""
    folder = tmp_path_factory.mktemp("kept")
    sledge().write_csv(folder / "sledge.csv")
    (folder / "sledge.toml").write_text(MACHINE)
    machine = load_machine(folder / "sledge.toml")
    with open_log(folder / "sledge.csv", time=find_time_axis_of_machine(machine)) as opened:
        return write_recording(run(opened, machine), folder / "out.rrd")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log that weighs in as little time as possible."""
    path = tmp_path / "sledge.csv"
    sledge(seconds=20.0).write_csv(path)
    return path


@pytest.mark.heavy
@pytest.mark.parametrize(
    "words",
    mark_slow_after(1, [["gate", "--format", "csv"], [], ["gate"], ["gate", "--format", "json"]]),
    ids=lambda words: " ".join(words) or "stages",
)
def test_a_reader_that_closes_the_pipe_is_no_fault(recording: Path, words: list[str]) -> None:
    with subprocess.Popen(
        [SCRIPT, "show", recording, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as shown:
        assert shown.stdout is not None
        assert shown.stderr is not None
        shown.stdout.close()
        assert b"Traceback" not in shown.stderr.read()
    assert shown.returncode == 0


@pytest.mark.heavy
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("words", mark_slow_after(1, [["gate", "--format", "csv"], [], ["masses"]]))
def test_a_full_disk_behind_stdout_is_one_line(recording: Path, words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        left = subprocess.run(
            [SCRIPT, "show", recording, *words],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert left.returncode == 2
    assert left.stderr == "payscope: stdout: No space left on device\n"


def limited(size: int, *words: object) -> "subprocess.CompletedProcess[str]":
    """The command where a file may have `size` bytes, so that writing fails as on a full disk."""
    limit = (
        f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size})); "
        "from replay.commands.cli import main; main()"
    )
    return subprocess.run(
        # Python 3.11 would keep modules that it compiles cut short by the limit
        [sys.executable, "-B", "-c", limit, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform == "win32", reason="files have no limit there")
def test_a_disk_that_fills_up_under_a_recording_is_one_line_and_leaves_nothing(
    log: Path, machine_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "full" / "out.rrd"
    out.parent.mkdir()
    left = limited(100_000, "run", log, "-m", machine_file, "-o", out)
    assert left.returncode == 2
    assert left.stderr == f"payscope: {out}: cannot be written (File too large)\n"
    assert list(out.parent.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="files have no limit there")
@pytest.mark.parametrize("suffix", mark_slow_after(2, [".csv", ".parquet", ".json"]))
def test_a_disk_that_fills_up_under_a_table_is_one_line_and_leaves_nothing(
    recording: Path, tmp_path: Path, suffix: str
) -> None:
    out = tmp_path / "full" / f"aligned{suffix}"
    out.parent.mkdir()
    left = limited(1_000, "show", recording, "aligned", "-o", out)
    assert left.returncode == 2
    assert left.stderr == f"payscope: {out}: cannot be written (File too large)\n"
    assert list(out.parent.iterdir()) == []


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform == "win32", reason="files have no limit there")
def test_a_disk_that_fills_up_under_rows_of_a_query_is_one_line_and_leaves_nothing(
    log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "full" / "rows.parquet"
    out.parent.mkdir()
    left = limited(1_000, "query", log, "SELECT * FROM sledge", "-o", out)
    assert left.returncode == 2
    assert left.stderr.startswith(f"payscope: {out}: cannot be written (")
    assert left.stderr.count("\n") == 1
    assert list(out.parent.iterdir()) == []


def test_a_signal_before_the_command_line_is_there_is_no_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(_: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(payscope, "import_module", interrupt)
    with pytest.raises(SystemExit) as left:
        payscope.main()
    assert left.value.code == 130


def test_a_signal_within_compiled_code_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(**_: bool) -> int:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise SystemError("a call returned a result with an exception set") from error
        return 0

    before = {number: signal.getsignal(number) for number in SIGNALS}
    monkeypatch.setattr(cli, "app", interrupted)
    try:
        with pytest.raises(SystemExit) as left:
            cli.main()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert left.value.code == 130


def test_a_signal_while_the_hidden_folder_goes_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remove, interrupted = shutil.rmtree, []

    def interrupt_once(path: Path, **options: bool) -> None:
        if not interrupted:
            interrupted.append(path)
            raise KeyboardInterrupt
        remove(path, **options)

    monkeypatch.setattr(shutil, "rmtree", interrupt_once)
    with pytest.raises(KeyboardInterrupt):
        require_writable_output(tmp_path / "out.rrd", overwrites=False)
    assert interrupted
    assert list(tmp_path.iterdir()) == []


@pytest.mark.heavy
@pytest.mark.parametrize(
    "number", mark_slow_after(1, [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
)
def test_ended_in_the_middle_it_leaves_no_half_file(tmp_path: Path, number: signal.Signals) -> None:
    folder = tmp_path / "demo"
    with subprocess.Popen([SCRIPT, "demo", "-o", folder], stderr=subprocess.PIPE) as demo:
        until = time.monotonic() + 60
        while not list(folder.glob(".payscope-*")) and time.monotonic() < until:
            time.sleep(0.01)
        demo.send_signal(number)
        assert demo.stderr is not None
        assert demo.stderr.read() == b""
    assert demo.returncode == 128 + number
    assert not list(folder.glob(".payscope-*"))


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform == "win32", reason="a shell is needed")
@pytest.mark.parametrize("closed", mark_slow_after(1, ["<&- >&- 2>&-", ">&-", "<&-", "2>&-"]))
def test_streams_that_are_closed_from_the_beginning_are_no_fault(
    log: Path, machine_file: Path, tmp_path: Path, closed: str
) -> None:
    out = tmp_path / "out.rrd"
    left = subprocess.run(
        ["sh", "-c", f'"$@" {closed}', "sh", SCRIPT, "run", log, "-m", machine_file, "-o", out],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert left.returncode == 0
    assert "Traceback" not in left.stderr
    assert out.exists()
