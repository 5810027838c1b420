"""The command `plot`: pictures of a recording, or of a stretch of it."""

import math
from pathlib import Path
from typing import Final

from estimators.errors import RecordingError
from recordings import plot_run
from recordings.report.picture import check_picture
from recordings.rrd.recording_window import read_window

#: What is drawn around a moment, in s either way.
AROUND_S: Final = 15.0


def plot(
    recording: Path,
    output: Path,
    figure: str = "page",
    *,
    at_s: float | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    force: bool = False,
) -> Path:
    """Draw a recording.

    Args:
        recording: the recording.
        output: the picture; its suffix says the format.
        figure: one of `recordings.plots.run_plots.FIGURES`.
        at_s: a moment to mark; without a stretch, what lies `AROUND_S` around it is drawn.
        from_s: where the stretch begins, in seconds since the start.
        to_s: where it ends.
        force: whether to replace a picture that is there already.

    Raises:
        PayscopeError: no such recording, nothing in that stretch, or the picture cannot be written.
    """
    check_picture(output, force=force)
    if at_s is not None:
        if not math.isfinite(at_s):
            raise RecordingError(f"--at {at_s}: is no time; name seconds since the start")
        if from_s is None and to_s is None:
            from_s, to_s = at_s - AROUND_S, at_s + AROUND_S
        elif (from_s is not None and at_s < from_s) or (to_s is not None and at_s > to_s):
            raise RecordingError(
                f"--at {at_s:g}: lies outside of what --from and --to draw; leave one of them out"
            )
    run = read_window(recording, from_s, to_s, raw=False)
    return plot_run(run, output, figure=figure, at_s=at_s, force=force)
