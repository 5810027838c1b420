"""`follow --live`: the real server, on this machine alone, and a real browser."""

import json
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from mcap.writer import CompressionType

from analysis.simulation import Scenario
from recordings.report import colours
from recordings.rrd.viewer_server import serve_viewer_to_browsers
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.follow.recorders import mcap_recorder

REPO = Path(__file__).resolve().parents[3]
TWO_STARTS = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 2}})
#: How long a page may take to draw what the server has, in s.
PATIENCE_S = 120
#: The colour of the first line of a plot.
LINE_RGB = np.array([int(colours.choose_line_colour(0)[k : k + 2], 16) for k in (1, 3, 5)])


@pytest.fixture
def page(tmp_path: Path) -> Iterator[str]:
    """The page of a follower that waits for more."""
    (source,) = simulate_scenario_to_logs(TWO_STARTS, tmp_path / "source.mcap")
    log = tmp_path / "drive.mcap"
    for _ in mcap_recorder(source, log, CompressionType.ZSTD):
        pass
    log.write_bytes(log.read_bytes()[:-100_000])
    words = ["follow", str(log), "-m", "cat262c.toml", "--live", "--json", "--idle-s", "600"]
    process = subprocess.Popen(
        [sys.executable, "-P", str(REPO / "payscope.py"), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    found = re.search(r"open (http://127\.0\.0\.1:\S+)", process.stderr.readline())
    assert found
    next(line for line in process.stdout if json.loads(line)["t_s"] > 10)
    yield found[1]
    process.kill()
    process.communicate()


@pytest.fixture
def browser() -> Iterator[Any]:
    """A browser that draws without a graphics card."""
    found = shutil.which("chromium")
    if found is None:
        pytest.skip("chromium: not installed (Debian package chromium)")
    from playwright.sync_api import sync_playwright

    without_card = ["--use-gl=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(
            executable_path=found, args=["--no-sandbox", *without_card]
        )
        yield launched
        launched.close()


@pytest.mark.heavy
def test_a_browser_shows_what_is_followed(page: str, tmp_path: Path, browser: Any) -> None:
    opened = browser.new_page(viewport={"width": 1200, "height": 800})
    opened.goto(page)
    picture = tmp_path / "live.png"
    for _ in range(PATIENCE_S):
        opened.wait_for_timeout(1000)
        opened.screenshot(path=picture)
        seen = np.round(255 * plt.imread(picture)[..., :3]).astype(int)
        if (np.abs(seen - LINE_RGB).max(axis=2) < 12).sum() > 500:
            return
    pytest.fail(f"no line was drawn within {PATIENCE_S} s")


def test_the_server_listens_on_this_machine_alone_and_ends_with_its_context() -> None:
    with serve_viewer_to_browsers() as server:
        host, port = re.findall(r"//([\d.]+):(\d+)", server.page)[0]
        assert host == "127.0.0.1"
        assert is_open(host, int(port))
        assert not is_open(own_address(), int(port))
    assert not is_open(host, int(port))


def is_open(host: str, port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((host, port)) == 0


def own_address() -> str:
    """Another address of this machine; of the loop where it has none."""
    try:
        found = socket.gethostbyname(socket.gethostname())
    except OSError:
        found = ""
    return found if found and not found.startswith("127.0.0.1") else "127.0.0.2"
