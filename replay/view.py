"""The command `view`: a recording, or a stretch of it, in the viewer or in pictures."""

import tempfile
from contextlib import ExitStack
from pathlib import Path

from estimators.errors import OutputError
from recordings import write_recording
from recordings.viewer import open_viewer, screenshots
from recordings.window import read_window


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
    with ExitStack() as stack:
        shown = recording
        if from_s is not None or to_s is not None:
            # the viewer has read it when it is opened, and needs it no more
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="payscope-")))
            shown = write_recording(read_window(recording, from_s, to_s), folder / recording.name)
        if screenshot is None:
            open_viewer(shown, at_s)
            return []
        if screenshot.exists() and not screenshot.is_dir():
            raise OutputError(f"{screenshot}: is a file; name a folder for the pictures")
        screenshot.mkdir(parents=True, exist_ok=True)
        return [each.png for each in screenshots(shown, screenshot, tab, at_s)]
