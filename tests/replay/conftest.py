"""Small logs and machine files for the tests of the command line, and a browser for its pages."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from recordings.calibration.digest_process import digest_files
from replay.commands import progress_bar
from replay.commands.cli import app, main
from tests.made_once import make_folder_once
from tests.replay.kept_replays import kept_replays, replays_anew
from tests.replay.made_evidence import Made, write_evidence
from tests.replay.sledge import MACHINE, Payscope, Said, sledge


@pytest.fixture(scope="session")
def commands() -> Any:
    """The commands with their options, which typer puts together anew at every call."""
    return typer.main.get_command(app)  # pyright: ignore


@pytest.fixture
def payscope(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, commands: Any
) -> Payscope:
    """Run the command line as a user would; the exit status, stdout and stderr."""

    raised: list[Exception] = []

    def noted(**options: Any) -> Any:
        try:
            return commands(**options)
        except Exception as error:
            raised.append(error)
            raise

    monkeypatch.setitem(main.__globals__, "app", noted)
    # whether the loops are compiled already depends on the tests before
    monkeypatch.setattr(progress_bar, "LONG_S", float("inf"))

    def call(*words: object) -> Said:
        raised.clear()
        monkeypatch.setattr(sys, "argv", ["payscope", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        error = raised[0] if raised else None
        return Said(int(left.value.code or 0), captured.out, captured.err, error)

    return call


@pytest.fixture
def machine_file(tmp_path: Path) -> Path:
    path = tmp_path / "sledge.toml"
    path.write_text(MACHINE)
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "sledge.csv"
    sledge().write_csv(path)
    return path


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    with kept_replays():
        return Made(make_folder_once(tmp_path_factory.getbasetemp() / "evidence", write_evidence))


@pytest.fixture(scope="module")
def without_pdf() -> Iterator[None]:
    """An installation without WeasyPrint: the PDF of evidence takes longer than the rest of it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, "weasyprint", None)
        yield


@pytest.fixture(scope="module", name="kept_replays")
def kept_replays_of_module() -> Iterator[None]:
    with kept_replays():
        yield


@pytest.fixture
def not_kept() -> Iterator[None]:
    """Replays of a test whose stages are the statement, where others of the module are kept."""
    with replays_anew():
        yield


@pytest.fixture
def readers_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings and PDFs of evidence are read here: a process for each takes a second to start.

    Damaged ones are read by that process in `test_compare_files.py`.
    """
    monkeypatch.setattr("recordings.calibration.untrusted_files.run_reader_process", digest_files)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    found = shutil.which("chromium")
    if found is None:
        pytest.skip("chromium: not installed (Debian package chromium)")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=found, args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium: Any, page_file: Path, request: pytest.FixtureRequest) -> Iterator[Any]:
    """The module's `page_file` in a browser, what it asked for and what it complained of."""
    width, scheme = request.param
    context = chromium.new_context(
        viewport={"width": width, "height": 800},
        color_scheme=scheme,
        offline=True,
        permissions=["clipboard-read", "clipboard-write"],
    )
    page: Any = context.new_page()
    page.asked, page.complaints = [], []
    page.on("request", lambda each: page.asked.append(each.url))
    page.on("console", lambda message: page.complaints.append(message.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.goto(page_file.as_uri())
    yield page
    context.close()
