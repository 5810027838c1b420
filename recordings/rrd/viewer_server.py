"""Serve the Rerun viewer to browsers, which show a recording while it is sent."""

import ctypes
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from estimators.errors import RecordingError
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.viewer import find_viewer_executable

_HOST: Final = "127.0.0.1"
#: Memory of rows that the server keeps for later browsers; the oldest are dropped first.
_MEMORY: Final = "256MB"
#: Option of Linux's prctl for the signal that a process gets when its parent ends or is killed.
_PR_SET_PDEATHSIG: Final = 1


@dataclass(frozen=True, slots=True)
class ViewerServer:
    """A running server.

    Attributes:
        address: address to which recordings are sent.
        page: URL for a browser on this machine.
    """

    address: str
    page: str


@contextmanager
def serve_viewer_to_browsers() -> Generator[ViewerServer]:
    """Context that serves the viewer to browsers on this machine.

    Raises:
        RecordingError: the server does not start.
    """
    port, page_port = _find_free_port(), _find_free_port()
    address = f"rerun+http://{_HOST}:{port}/proxy"
    page = f"http://{_HOST}:{page_port}"
    words = ["--serve-web", "--bind", _HOST, "--port", str(port)]
    words += ["--web-viewer-port", str(page_port), "--server-memory-limit", _MEMORY]
    process = subprocess.Popen(
        [find_viewer_executable(), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # ctrl-C reaches only the follower, which ends the server last
        preexec_fn=_terminate_with_parent_process if sys.platform == "linux" else None,
    )
    try:
        _wait_until_page_is_served(process, page)
        yield ViewerServer(address, f"{page}?url={quote(address, safe='')}")
    finally:
        process.terminate()
        process.wait()


def _find_free_port() -> int:
    with socket.socket() as free:
        free.bind((_HOST, 0))
        return int(free.getsockname()[1])


def _terminate_with_parent_process() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _wait_until_page_is_served(process: "subprocess.Popen[bytes]", page_address: str) -> None:
    deadline = time.monotonic() + LIMITS.server_start_s
    while time.monotonic() < deadline and process.poll() is None:
        try:
            with urllib.request.urlopen(page_address, timeout=LIMITS.server_start_s):  # noqa: S310 our own page
                return
        except (urllib.error.URLError, OSError):
            time.sleep(LIMITS.server_look_s)
    raise RecordingError(
        "--live: the viewer's server did not start within the time limit; try again, or leave out "
        "--live"
    )
