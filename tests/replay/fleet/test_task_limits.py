"""The limits of a task: over them it ends with the reason, and the process goes on."""

import os
import time
from pathlib import Path

import pytest

from replay.fleet.last_run import TaskLimits
from replay.fleet.recording_task import (
    LimitError,
    interrupt_over_limits,
    read_resident_memory_bytes,
)
from replay.fleet.run_fleet import FleetRun
from tests.replay.fleet.conftest import Run

_MUCH = 1 << 40


def test_what_takes_too_long_is_interrupted_also_in_a_system_call() -> None:
    began = time.monotonic()
    with (
        pytest.raises(LimitError, match=r"took longer than 0\.2 s"),
        interrupt_over_limits(0.2, _MUCH),
    ):
        time.sleep(30.0)
    assert time.monotonic() - began < 10.0


def test_the_limit_is_named_also_where_compiled_code_is_interrupted() -> None:
    def run_compiled() -> None:
        try:
            time.sleep(10.0)
        except LimitError as error:
            raise SystemError("a call returned a result with an exception set") from error

    with (
        pytest.raises(LimitError, match=r"took longer than 0\.2 s"),
        interrupt_over_limits(0.2, _MUCH),
    ):
        run_compiled()


def test_what_needs_too_much_memory_is_interrupted() -> None:
    held: list[bytes] = []

    def grow() -> None:
        with interrupt_over_limits(60.0, 64 << 20):
            for _ in range(200):
                held.append(b"\1" * (8 << 20))
                time.sleep(0.02)

    with pytest.raises(LimitError, match=r"needed more than .* GiB of memory"):
        grow()
    assert len(held) < 100


def test_what_the_process_held_before_is_not_of_the_task() -> None:
    before = b"\1" * (256 << 20)
    assert read_resident_memory_bytes() > len(before)
    with interrupt_over_limits(60.0, 128 << 20):
        time.sleep(0.3)
    del before


def test_within_the_limits_nothing_happens_and_the_signal_is_given_back() -> None:
    import signal

    before = signal.getsignal(signal.SIGALRM)
    with interrupt_over_limits(60.0, _MUCH):
        time.sleep(0.01)
    assert signal.getsignal(signal.SIGALRM) == before


def test_memory_is_declared_by_the_size_of_the_log() -> None:
    limits = TaskLimits(memory_GiB=1.0, memory_per_byte=2.0)
    assert limits.compute_memory_bytes_for_log(10**9) == 2**30 + 2 * 10**9


@pytest.mark.heavy
def test_a_log_that_hangs_is_listed_with_its_limit_and_costs_nobody_else(
    run_in: Run, fleet_folder: Path, tmp_path: Path
) -> None:
    """A pipe that nobody writes to: opening it never comes back."""
    import shutil

    home = shutil.copytree(fleet_folder / "logs/unit-01", tmp_path / "logs/unit-01")
    hanging = home / "hanging.mcap"
    hanging.write_bytes(b"")
    rules = (fleet_folder / "fleet.toml").read_text()
    (tmp_path / "fleet.toml").write_text(f"[limits]\nseconds = 8.0\n{rules}")

    class Piped:
        """Once the logs are listed, one becomes a pipe."""

        def __new__(cls) -> object:
            from benchmarks.fleet_logs import SerialEngine

            hanging.unlink()
            os.mkfifo(hanging)
            return SerialEngine()

    did: FleetRun = run_in(
        tmp_path / "results", tmp_path / "logs", tmp_path / "fleet.toml", engine=Piped
    )
    assert did.replayed == 2
    assert list(did.failed.values()) == ["took longer than 8 s, its limit"]
