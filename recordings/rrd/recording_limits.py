"""Limits of a recording, and sizes of what the viewer draws of it."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class RecordingLimits:
    """Limits of a recording, and sizes of what the viewer draws of it.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # blueprint
    #: Height of a page in points of a laptop's screen,
    page_height: float = 860.0
    #: what lanes need of it for title and times,
    lanes_margin: float = 70.0
    #: and for each.
    lane_height: float = 40.0
    #: What a plot needs of it for title and times,
    plot_margin: float = 55.0
    #: and for each name of its legend, which the viewer gives four fifths of the height.
    legend_name_height: float = 23.0 / 0.8
    #: Largest fraction of a page for lanes.
    lanes_max_fraction: float = 0.6
    #: Room for legends behind the log, as a fraction of it,
    legend_room_fraction: float = 0.18
    #: and in a panel beside a text, which is narrower.
    narrow_legend_room_fraction: float = 0.3

    # display_frames
    #: Bins of a long log on the screen: more than it has pixels.
    screen_bins: int = 3000
    #: Lines beyond which they are too short to be seen,
    many_lines: int = 12
    #: if they have so few points.
    short_line_points: int = 3

    # drawn_rows
    #: Rows of a chunk that is written at once.
    drawn_chunk_rows: int = 16_384

    # piped_file
    #: Bytes that are copied at once.
    copied_block_bytes: int = 1 << 20

    # plane_pictures
    #: Points of a group that are kept; more lie on one another.
    plane_max_points: int = 2000
    #: Left, top, right and bottom of the axes, in units of the plane.
    plane_box: tuple[float, float, float, float] = (0.0, 0.0, 1000.0, 560.0)
    #: Left, top, right and bottom of what the view shows: numbers, labels and legend as well.
    plane_bounds: tuple[float, float, float, float] = (-130.0, -75.0, 1310.0, 665.0)
    #: Units from the axes to their numbers,
    plane_numbers_distance: float = 16.0
    #: to their labels,
    plane_labels_distance: float = 60.0
    #: and to the middle of the legend,
    plane_legend_distance: float = 160.0
    #: units of a line of it,
    plane_legend_line: float = 38.0
    #: and units below its place at which the viewer writes.
    plane_text_drop: float = 12.0
    #: Distance between the errors of two methods, as a fraction of the range of loads.
    method_distance_fraction: float = 0.012
    #: Points of the screen from the middle to the edge of a dot,
    dot_radius_pt: float = 2.5
    #: of a line,
    line_radius_pt: float = 0.7
    #: and of a line of the grid.
    grid_line_radius_pt: float = 0.3

    # recording_texts
    #: Findings beside the answer; their own text has all.
    max_findings: int = 3
    #: Lines of a page's loads.
    max_load_lines: int = 12

    # recording_window
    #: Time in s that is later than any recording, and still whole nanoseconds.
    latest_s: float = 1e9

    # stored_frames
    #: Rows of a block: larger ones are slower to write and to read, smaller ones larger.
    stored_block_rows: int = 65_536

    # viewer
    #: Time in s that the viewer may take to start,
    viewer_start_s: float = 60.0
    #: between two pictures of it,
    viewer_settle_s: float = 0.5
    #: and between two attempts to connect.
    viewer_poll_s: float = 0.1

    # viewer_server
    #: Time in s that the server may take to answer: it loads half a gigabyte from the disc,
    server_start_s: float = 60.0
    #: and between two looks whether it answers.
    server_look_s: float = 0.1

    # viewer_stream
    #: Rows of a topic beyond which it is drawn by the mean and the extremes of bins,
    stream_max_rows: int = 200_000
    #: and the number of these.
    stream_bins: int = 20_000
    #: Tabs that fit beside each other,
    max_tabs: int = 14
    #: and panels below each other.
    max_panels: int = 8

    # writer
    #: Bytes of chunks that wait to be written.
    waiting_bytes: int = 1 << 26
    #: Time in s without progress after which the disk or the viewer counts as stuck.
    stuck_s: float = 10.0


#: The values in use.
LIMITS: Final = RecordingLimits()
