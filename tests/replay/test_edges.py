"""Compiled code, which nobody stops, stays inside the bytes it is given, however damaged."""

import signal
import subprocess
import sys

import pytest

from tests.conftest import REPO

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pages are guarded by mprotect")


def ended(*cases: str) -> int:
    """How a process ends that goes through cases of `at_the_edge`."""
    command = [sys.executable, "-m", "tests.replay.at_the_edge", *cases]
    return subprocess.run(command, cwd=REPO, check=False).returncode


@pytest.mark.heavy
def test_a_load_that_reaches_one_byte_too_far_ends_the_process() -> None:
    assert ended("overreach") in (-signal.SIGSEGV, -signal.SIGBUS)


@pytest.mark.parametrize(
    "cases",
    [
        pytest.param(("mcap", "bag", "sqlite"), id="containers"),
        pytest.param(
            ("cdr_le", "cdr_be", "xcdr2_le", "xcdr2_be", "ros1", "text"),
            id="messages",
            marks=pytest.mark.heavy,
        ),
    ],
)
def test_damaged_bytes_lead_no_load_out_of_them(cases: tuple[str, ...]) -> None:
    assert ended(*cases) == 0
