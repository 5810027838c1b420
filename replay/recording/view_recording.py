"""The commands `view` and `plot`: show a recording, or part of it, in the viewer or as pictures."""

import math
import shutil
import tempfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from estimators.errors import OutputError, RecordingError
from recordings import plot_run, read_provenance, write_recording
from recordings.report.picture import require_writable_picture
from recordings.rrd.recording_limits import LIMITS as RECORDING_LIMITS
from recordings.rrd.recording_window import read_run_of_time_range
from recordings.rrd.viewer import open_recording_in_viewer, take_screenshots_of_recording
from recordings.rrd.writer import SUFFIX

#: Time in s that is drawn before and after a moment.
AROUND_S: Final = 15.0


def parse_moment_of_run_s(recording: Path, text: str) -> float:
    """Parse a moment of a recording's run, in s since its start.

    Args:
        recording: the recording.
        text: seconds since the start, or a time in ISO 8601, in UTC without a zone.

    Raises:
        RecordingError: the text is neither, or the recording cannot be read.
    """
    try:
        return float(text)
    except ValueError:
        pass
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        raise RecordingError(
            f"--at {text}: is not a time; give seconds since the start, or 2026-11-23T06:12:03Z"
        ) from None
    moment = time if time.tzinfo else time.replace(tzinfo=UTC)
    # as integer microseconds: a float of seconds since 1970 resolves only a quarter of one
    since_epoch_us = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)
    return (since_epoch_us * 1000 - read_provenance(recording).t0_unix_ns) / 1e9


def view_recording(
    recording: Path,
    from_s: float | None = None,
    to_s: float | None = None,
    *,
    at_s: float | None = None,
    screenshot: Path | None = None,
    tab_title: str | None = None,
) -> list[Path]:
    """Open the viewer, or write screenshots of its tabs.

    Args:
        recording: the recording.
        from_s: start of the shown stretch, in seconds since the run's start.
        to_s: end of the shown stretch, in seconds since the run's start.
        at_s: time of the cursor.
        screenshot: folder for screenshots; None opens the viewer.
        tab_title: title of the only tab to write; None writes all.

    Returns:
        Paths of the screenshots.

    Raises:
        PayscopeError: the recording, the viewer or the tab does not exist, or the stretch is empty.
    """
    if tab_title is not None and screenshot is None:
        raise OutputError(
            f"--tab {tab_title}: selects the tab of a screenshot; add --screenshot FOLDER"
        )
    if at_s is not None and not abs(at_s) <= RECORDING_LIMITS.latest_s:
        raise RecordingError(f"--at {at_s}: is not a time; give seconds since the start")
    if screenshot is not None and screenshot.exists() and not screenshot.is_dir():
        raise OutputError(f"{screenshot}: is a file; give a folder for the pictures")
    # once it is open, the viewer has read the stretch and no longer needs the file
    with tempfile.TemporaryDirectory(prefix="payscope-") as folder:
        shown = recording
        if from_s is not None or to_s is not None:
            stretch = read_run_of_time_range(recording, from_s, to_s)
            shown = write_recording(stretch, Path(folder) / f"{recording.stem}{SUFFIX}")
        if screenshot is None:
            open_recording_in_viewer(shown, at_s)
            return []
        drawn = take_screenshots_of_recording(shown, folder, tab_title, at_s)
        screenshot.mkdir(parents=True, exist_ok=True)
        return [Path(shutil.move(each.png, screenshot / each.png.name)) for each in drawn]


def plot_recording(
    recording: Path,
    picture_path: Path,
    figure_name: str = "page",
    *,
    at_s: float | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    overwrites: bool = False,
) -> Path:
    """Draw a recording.

    Args:
        recording: the recording.
        picture_path: path of the picture; its suffix sets the format.
        figure_name: one of `recordings.plots.run_plots.FIGURES`.
        at_s: moment to mark; without a stretch, `AROUND_S` on either side is drawn.
        from_s: start of the stretch, in seconds since the run's start.
        to_s: end of the stretch, in seconds since the run's start.
        overwrites: whether to replace an existing picture.

    Raises:
        PayscopeError: the recording does not exist, the stretch is empty, or the picture cannot be
            written.
    """
    require_writable_picture(picture_path, overwrites=overwrites)
    if at_s is not None:
        if not math.isfinite(at_s):
            raise RecordingError(f"--at {at_s}: is not a time; give seconds since the start")
        if from_s is None and to_s is None:
            from_s, to_s = at_s - AROUND_S, at_s + AROUND_S
        elif (from_s is not None and at_s < from_s) or (to_s is not None and at_s > to_s):
            raise RecordingError(f"--at {at_s:g}: lies outside --from and --to; change one of them")
    run = read_run_of_time_range(recording, from_s, to_s, are_raw_frames_read=False)
    return plot_run(run, picture_path, figure_name=figure_name, at_s=at_s, overwrites=overwrites)
