"""Write picture files, whose suffix selects the format, and of which no partial file remains."""

from pathlib import Path
from typing import TYPE_CHECKING, Final
from warnings import catch_warnings, filterwarnings

from estimators.errors import OutputError
from recordings.report.atomic_output import require_writable_output, stage_output_file
from recordings.report.report_limits import LIMITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES: Final = (".png", ".pdf", ".svg")


def require_writable_picture(path: Path, *, overwrites: bool) -> None:
    """Raise an error, before drawing, if a picture file cannot be written.

    Raises:
        OutputError: the suffix is not supported, the file exists, or its folder cannot be written
            to.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: no picture format '{path.suffix}'; use {', '.join(SUFFIXES)}")
    require_writable_output(path, overwrites=overwrites)


def write_picture(figure: "Figure", path: Path, *, overwrites: bool) -> Path:
    """Write a figure in the format of the file's suffix, and return the file's path.

    Raises:
        OutputError: as from `require_writable_picture`, or if writing fails.
    """
    require_writable_picture(path, overwrites=overwrites)
    with stage_output_file(path, overwrites=overwrites) as partial, catch_warnings():
        filterwarnings("ignore", "Glyph", UserWarning)  # names with characters that the font lacks
        figure.savefig(partial, dpi=LIMITS.picture_dpi)
    return path


def draw_legend_beside_axes(axes: "Axes", font_size: float = 7.0) -> None:
    """Draw a legend to the right of the axes, unless there is only one line."""
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) > 1:
        axes.legend(
            handles,
            labels,
            fontsize=font_size,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            borderaxespad=0.2,
        )


def draw_legend_above_axes(axes: "Axes", font_size: float = 6.0) -> None:
    """Draw a legend above the axes, unless there is only one line."""
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(
            fontsize=font_size,
            loc="lower right",
            bbox_to_anchor=(1, 1),
            ncols=7,
            frameon=False,
            borderpad=0,
            columnspacing=1.0,
            handletextpad=0.4,
        )
