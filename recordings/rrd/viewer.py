"""Run the Rerun viewer: show a recording, or take screenshots of its tabs without a display.

The viewer is started here and not by Rerun's `spawn`, which listens on every network interface.
"""

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from estimators.errors import OutputError, RecordingError, suggest_choice
from recordings.rrd.reader import read_provenance
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.stored_names import TIME

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

_HOST: Final = "127.0.0.1"
_WINDOW: Final = "1600x1000"


@dataclass(frozen=True, slots=True)
class Screenshot:
    """Screenshot of a tab, and the errors of its views."""

    tab: str
    png: Path
    errors: tuple[str, ...]


def open_recording_in_viewer(
    path: str | Path, at_s: float | None = None
) -> subprocess.Popen[bytes]:
    """Open a recording in the viewer, which stays open when this process ends.

    Args:
        path: the recording.
        at_s: position of the time cursor, in seconds since the start.

    Raises:
        RecordingError: the recording cannot be read, or the viewer does not start.
    """
    t0_ns = read_provenance(path).t0_unix_ns
    with tempfile.TemporaryFile() as log:
        process, port = start_viewer_process(Path(path), log)
        client = wait_for_client_of_viewer(
            process, port, log, "a screen; without one, use `payscope plot`"
        )
    if at_s is not None:
        _set_time_cursor(client, t0_ns + round(at_s * 1e9))
    return process


def start_waiting_viewer() -> str:
    """Start a viewer that waits for a recording, and stays open after this process.

    Returns:
        Address for `write_recording` to stream to.

    Raises:
        RecordingError: the viewer does not start.
    """
    with tempfile.TemporaryFile() as log:
        process, port = start_viewer_process(None, log)
        wait_for_client_of_viewer(
            process, port, log, "a screen; without one, leave out --live", waits_for_recording=True
        )
    return _make_viewer_address(port)


def list_ids_of_shown_recordings(viewer_address: str) -> tuple[str, ...]:
    """Ids of the recordings in a viewer; empty if no viewer answers."""
    from rerun.experimental import ViewerClient

    try:
        state = ViewerClient.connect(viewer_address).get_state()
    except (ConnectionError, RuntimeError):
        return ()
    return tuple(each.store_id for each in state.recordings)


def replace_recording_in_viewer(viewer_address: str, earlier_ids: Sequence[str]) -> None:
    """Show the newest recording in place of the previous one, and close older ones.

    A viewer that was closed is ignored.

    Args:
        viewer_address: address of the viewer.
        earlier_ids: ids in the viewer before the newest recording (`list_ids_of_shown_recordings`).
    """
    from rerun.experimental import ViewerClient

    try:
        client = ViewerClient.connect(viewer_address)
        held = {each.store_id: each for each in client.get_state().recordings}
        new = [each for each in held if each not in earlier_ids]
        old = [each for each in earlier_ids if each in held]
        if not (new and old):
            return
        now_ns = held[old[-1]].current_time
        if now_ns is not None and held[old[-1]].current_timeline == TIME:
            at = np.datetime64(int(now_ns), "ns")
            client.set_time(TIME, timestamp=at, play_state="paused", recording=new[-1])
        if old[:-1]:
            client.close(store_ids=old[:-1])
    except (ConnectionError, RuntimeError):
        return


def take_screenshots_of_recording(
    path: str | Path, folder: str | Path, tab_title: str | None = None, at_s: float | None = None
) -> list[Screenshot]:
    """Take screenshots of a recording's tabs in the viewer, without a display.

    Hidden tabs are never evaluated, so each is activated in turn.

    Args:
        path: the recording.
        folder: existing folder for `NN-tab.png`.
        tab_title: name of a tab; None for all.
        at_s: position of the time cursor, in seconds since the start.

    Raises:
        RecordingError: the recording cannot be read, it has no such tab, or no viewer starts (it
            needs a Vulkan driver; on Debian `mesa-vulkan-drivers` is a software one).
        OutputError: the folder is missing.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder; create it first")
    t0_ns = read_provenance(path).t0_unix_ns
    return take_screenshots_of_recording_or_log(
        path, folder, tab_title, None if at_s is None else t0_ns + round(at_s * 1e9)
    )


def take_screenshots_of_recording_or_log(
    path: str | Path, folder: Path, tab_title: str | None = None, at_unix_ns: int | None = None
) -> list[Screenshot]:
    """Take screenshots like `take_screenshots_of_recording`, of any file that the viewer opens.

    Args:
        path: a recording, or a log with an importer.
        folder: existing folder for `NN-tab.png`.
        tab_title: name of a tab; None for all.
        at_unix_ns: position of the time cursor, as Unix time in ns; None for the default.

    Raises:
        RecordingError: the viewer cannot open the file, it lacks the tab, or the viewer does not
            start.
    """
    with run_headless_viewer(Path(path)) as (client, _):
        if at_unix_ns is not None:
            _set_time_cursor(client, at_unix_ns)
        whole = client.get_blueprint("recording").blueprint
        tabs = _find_tabs_container(whole)
        names = [_read_tab_title(whole, entity) for entity in _list_child_entities(tabs)]
        if tab_title is not None and tab_title.casefold() not in map(str.casefold, names):
            raise RecordingError(
                f"{path}: shows no tab '{tab_title}'; {suggest_choice(tab_title, names)}"
            )
        return list(_take_screenshots_of_tabs(client, folder, whole, tabs, tab_title))


def _find_tabs_container(blueprint: dict[str, Any]) -> dict[str, Any]:
    """Find the container of the tabs in a blueprint."""
    return next(
        layout["ContainerBlueprint"]
        for layout in blueprint.values()
        if layout.get("ContainerBlueprint", {}).get("container_kind") == "Tabs"
    )


def _read_tab_title(blueprint: dict[str, Any], entity: str) -> str:
    return blueprint[f"/{entity}"]["ContainerBlueprint"]["display_name"]


def _set_time_cursor(client: "ViewerClient", at_unix_ns: int) -> None:
    client.set_time(TIME, timestamp=np.datetime64(at_unix_ns, "ns"), play_state="paused")


def _take_screenshots_of_tabs(
    client: "ViewerClient",
    folder: Path,
    blueprint: dict[str, Any],
    tabs: dict[str, Any],
    tab_title: str | None,
) -> Iterator[Screenshot]:
    """Open the tabs one after the other, and take a screenshot of each."""
    for number, entity in enumerate(_list_child_entities(tabs)):
        name = _read_tab_title(blueprint, entity)
        if tab_title is not None and tab_title.casefold() != name.casefold():
            continue
        tabs["active_tab"] = entity
        client.set_blueprint(blueprint, "recording")
        # a tab of an imported log has the name of its topic
        png = folder / f"{number:02}-{name.lower().strip('/').replace('/', '-')}.png"
        png.write_bytes(wait_for_still_screenshot(client))
        shown = set(_iter_view_ids(blueprint, entity))
        errors = tuple(
            f"{view.name}: {report.summary}"
            for view in client.get_state().views
            if view.view_id in shown
            for report in view.reports
        )
        yield Screenshot(name, png, errors)


def wait_for_still_screenshot(client: "ViewerClient") -> bytes:
    """Take screenshots until two are equal, since data are still being loaded in the first ones."""
    before, deadline = b"", time.monotonic() + LIMITS.viewer_start_s
    while time.monotonic() < deadline:
        time.sleep(LIMITS.viewer_settle_s)
        picture = client.take_screenshot()
        if picture == before:
            break
        before = picture
    return before


def _list_child_entities(container: dict[str, Any]) -> list[str]:
    contents = container["contents"]
    return [contents] if isinstance(contents, str) else contents


def _iter_view_ids(blueprint: dict[str, Any], entity: str) -> Iterator[str]:
    """Yield the ids of the views in a container, at any depth."""
    kind, _, identifier = entity.partition("/")
    if kind == "view":
        yield identifier
        return
    for child in _list_child_entities(blueprint[f"/{entity}"]["ContainerBlueprint"]):
        yield from _iter_view_ids(blueprint, child)


class HeadlessViewer(NamedTuple):
    """A viewer that runs without a display: its client and its address."""

    client: "ViewerClient"
    address: str


@contextmanager
def run_headless_viewer(path: Path | None) -> "Generator[HeadlessViewer]":
    """Context with a viewer without a display: its client and address."""
    # "CI" disables Rerun's usage statistics, since nobody sees this viewer to consent
    with tempfile.TemporaryFile() as log:
        process, port = start_viewer_process(
            path, log, "--headless", "--window-size", _WINDOW, CI="1"
        )
        needs = "a Vulkan driver, like Debian's mesa-vulkan-drivers"
        try:
            client = wait_for_client_of_viewer(
                process, port, log, needs, waits_for_recording=path is None
            )
            yield HeadlessViewer(client, _make_viewer_address(port))
        finally:
            process.terminate()
            process.wait()


class ViewerProcess(NamedTuple):
    """Running viewer, and the port that it listens on."""

    process: subprocess.Popen[bytes]
    port: int


def start_viewer_process(
    path: Path | None, log_file: IO[bytes], *command_options: str, **environment: str
) -> ViewerProcess:
    """Start the viewer with or without a recording; it listens only on this machine."""
    with socket.socket() as free:
        free.bind((_HOST, 0))
        port = int(free.getsockname()[1])
    command = [find_viewer_executable(), "--bind", _HOST, "--port", str(port), *command_options]
    if path is not None:
        command.append(path.resolve())
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=log_file,
        stderr=log_file,
        env={**os.environ, **environment},
        start_new_session=True,
    )
    return ViewerProcess(process, port)


def _make_viewer_address(port: int) -> str:
    return f"rerun+http://{_HOST}:{port}/proxy"


def find_viewer_executable() -> Path:
    """Find the viewer in the installed Rerun package."""
    found = find_spec("rerun_cli")
    assert found is not None
    assert found.origin is not None
    folder = Path(found.origin).parent
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"
    return bundled if bundled.exists() else folder / ("rerun.exe" if os.name == "nt" else "rerun")


def wait_for_client_of_viewer(
    process: subprocess.Popen[bytes],
    port: int,
    log_file: IO[bytes],
    viewer_requirement: str,
    *,
    waits_for_recording: bool = False,
) -> "ViewerClient":
    """Wait until the viewer has loaded its recording, or waits for one, and return its client."""
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + LIMITS.viewer_start_s
    while time.monotonic() < deadline and process.poll() is None:
        time.sleep(LIMITS.viewer_poll_s)
        try:
            client = ViewerClient.connect(_make_viewer_address(port))
            state = client.get_state()
        except (ConnectionError, RuntimeError):
            continue  # not listening yet
        if waits_for_recording or (state.recordings and not state.loading):
            return client
    process.terminate()
    process.wait()
    log_file.seek(0)
    said = log_file.read().decode(errors="replace").strip().splitlines() or ["no message"]
    raise RecordingError(f"the viewer did not start: {said[-1]}; it needs {viewer_requirement}")
