"""Limits of a recording, and sizes of its views in the viewer."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class RecordingLimits:
    """Limits of a recording, and sizes of its views in the viewer.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # blueprint
    #: Height of a page in points of a laptop's screen.
    page_height: float = 860.0
    #: Height in points that a panel of lanes needs for title and times.
    lanes_margin: float = 70.0
    #: Height in points of a lane.
    lane_height: float = 40.0
    #: Height in points that a plot needs for title and times.
    plot_margin: float = 55.0
    #: Height in points that a plot needs per name of its legend, which has four fifths of the
    #: height.
    legend_name_height: float = 23.0 / 0.8
    #: Largest fraction of a page's height for lanes.
    lanes_max_fraction: float = 0.6
    #: Room for legends after the end of the log, as a fraction of its duration.
    legend_room_fraction: float = 0.18
    #: The same in a panel beside a text, which is narrower.
    narrow_legend_room_fraction: float = 0.3

    # display_frames
    #: Bins of a long log: more than a screen has pixels.
    screen_bins: int = 3000
    #: Number of separate lines beyond which short ones are drawn as points.
    many_lines: int = 12
    #: Mean number of points of a line up to which it is short.
    short_line_points: int = 3

    # drawn_rows
    #: Rows of a chunk.
    drawn_chunk_rows: int = 16_384

    # piped_file
    #: Bytes that are copied at once.
    copied_block_bytes: int = 1 << 20

    # plane_pictures
    #: Most points of a group that are drawn; more would cover each other.
    plane_max_points: int = 2000
    #: Left, top, right and bottom of the axes, in units of the plane.
    plane_box: tuple[float, float, float, float] = (0.0, 0.0, 1000.0, 560.0)
    #: Left, top, right and bottom of the view, including numbers, labels and legend.
    plane_bounds: tuple[float, float, float, float] = (-130.0, -75.0, 1310.0, 665.0)
    #: Distance from the axes to their numbers, in units of the plane.
    plane_numbers_distance: float = 16.0
    #: Distance from the axes to their labels, in units of the plane.
    plane_labels_distance: float = 60.0
    #: Distance from the axes to the middle of the legend, in units of the plane.
    plane_legend_distance: float = 160.0
    #: Height of a line of the legend, in units of the plane.
    plane_legend_line: float = 38.0
    #: Distance in units of the plane by which the viewer draws a text below its position.
    plane_text_drop: float = 12.0
    #: Distance between the errors of two methods, as a fraction of the range of loads.
    method_distance_fraction: float = 0.012
    #: Radius of a dot, in points of the screen.
    dot_radius_pt: float = 2.5
    #: Half width of a line, in points of the screen.
    line_radius_pt: float = 0.7
    #: Half width of a grid line, in points of the screen.
    grid_line_radius_pt: float = 0.3

    # recording_texts
    #: Most findings beside the answer; the text on findings has all.
    max_findings: int = 3
    #: Most lines on loads.
    max_load_lines: int = 12

    # recording_window
    #: Time in s that is later than any recording, and exact to the nanosecond.
    latest_s: float = 1e9

    # stored_frames
    #: Rows of a block: larger blocks are slower to write and read, smaller ones take more space.
    stored_block_rows: int = 65_536

    # viewer
    #: Time in s that the viewer may take to start.
    viewer_start_s: float = 60.0
    #: Time in s between screenshots.
    viewer_settle_s: float = 0.5
    #: Time in s between attempts to connect.
    viewer_poll_s: float = 0.1

    # viewer_server
    #: Time in s that the server may take to answer: it loads half a gigabyte from disk.
    server_start_s: float = 60.0
    #: Time in s between checks whether the server answers.
    server_look_s: float = 0.1

    # viewer_stream
    #: Rows of a topic beyond which it is drawn by mean and extremes of bins.
    stream_max_rows: int = 200_000
    #: Number of these bins.
    stream_bins: int = 20_000
    #: Most tabs, which must fit side by side.
    max_tabs: int = 14
    #: Most panels of a tab, which are one below the other.
    max_panels: int = 8

    # writer
    #: Most bytes of chunks that wait to be written.
    waiting_bytes: int = 1 << 26
    #: Time in s without progress after which the disk or the viewer counts as stuck.
    stuck_s: float = 10.0


#: The values in use.
LIMITS: Final = RecordingLimits()
