"""The command `view`: a recording, or a stretch of it, in the viewer or in pictures."""

import shutil
import tempfile
from pathlib import Path

from estimators.errors import OutputError, RecordingError
from recordings import write_recording
from recordings.rrd.recording_window import LATEST_S, read_window
from recordings.rrd.viewer import open_viewer, screenshots
from recordings.rrd.writer import SUFFIX


def view(
    recording: Path,
    from_s: float | None = None,
    to_s: float | None = None,
    *,
    at_s: float | None = None,
    screenshot: Path | None = None,
    tab: str | None = None,
) -> list[Path]:
    """Open the viewer, or write pictures of its tabs.

    Args:
        recording: the recording.
        from_s: where the stretch begins that is shown, in seconds since the start.
        to_s: where it ends.
        at_s: where to put the time cursor.
        screenshot: folder for the pictures; None opens the viewer.
        tab: of the pictures, that of this one alone.

    Returns:
        The pictures.

    Raises:
        PayscopeError: no such recording, nothing in that stretch, no viewer, no such tab.
    """
    if tab is not None and screenshot is None:
        raise OutputError(f"--tab {tab}: is of pictures; add --screenshot FOLDER")
    if at_s is not None and not abs(at_s) <= LATEST_S:
        raise RecordingError(f"--at {at_s}: is no time; name seconds since the start")
    if screenshot is not None and screenshot.exists() and not screenshot.is_dir():
        raise OutputError(f"{screenshot}: is a file; name a folder for the pictures")
    # the viewer has read a stretch when it is opened, and needs it no more
    with tempfile.TemporaryDirectory(prefix="payscope-") as folder:
        shown = recording
        if from_s is not None or to_s is not None:
            stretch = read_window(recording, from_s, to_s)
            shown = write_recording(stretch, Path(folder) / f"{recording.stem}{SUFFIX}")
        if screenshot is None:
            open_viewer(shown, at_s)
            return []
        drawn = screenshots(shown, folder, tab, at_s)
        screenshot.mkdir(parents=True, exist_ok=True)
        return [Path(shutil.move(each.png, screenshot / each.png.name)) for each in drawn]
