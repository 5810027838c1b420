"""Built-in limits of the stages from messages to signals, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class SignalLimits:
    """Built-in limits of the stages from messages to signals, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # align
    #: Longest hole in s of which the grid keeps every row: of longer ones it keeps the first and
    #: the last, since a clock jump must not make a billion rows.
    longest_gap_s: float = 60.0
    #: Hole in s of which a note is made: longer than a break in a shift.
    reported_gap_s: float = 3600.0
    #: Longest time in s that a channel may lack at an end of the log for that to be a gap: a shift
    #: and its night. What lies further off is a stamp of another clock.
    missing_end_max_s: float = 86400.0
    #: Share of a gap that a channel lacks for the gap to be one of its own: topics end apart.
    same_gap_1: float = 0.9
    #: Rows of the longest grid: eighty hours at 100 Hz, a quarter of a gigabyte a column.
    grid_max_rows: int = 30_000_000

    # copied_rows
    #: Fewest rows of a copy,
    copy_min_rows: int = 50
    #: its shortest duration in s,
    copy_min_s: float = 2.0
    #: and the fewest readings that differ in one of its channels: a coarse channel repeats itself.
    copy_min_readings: int = 20
    #: Fraction of the steps that change it in which noise turns back; a smooth channel turns less.
    noise_turn_fraction: float = 0.25
    #: Noise is judged by so many blocks
    noise_blocks: int = 32
    #: of so many rows.
    noise_block_rows: int = 4096
    #: Rows of a window whose hash is compared,
    copy_window_rows: int = 32
    #: and the fewest of them that differ from the row before.
    copy_window_min_changes: int = 8
    #: Mean distance in rows between windows: their own hash chooses where they begin.
    copy_window_spacing_rows: int = 8
    #: Most distances between copy and original that are compared row by row.
    copy_max_distances: int = 8

    # derive
    #: Step between two readings of a channel, in its median steps, that lacks none: stamps jitter.
    reading_gap_periods: float = 1.5
    #: Largest reading in SI units: no channel of a machine comes near it. What exceeds it stands
    #: for no reading (a logger's largest float, say), and its powers would leave the range of
    #: numbers in every fit.
    largest_si: float = 1e15
    #: Smallest reading in SI units that is not 0: no sensor resolves it, and its powers would be 0
    #: without saying so.
    smallest_si: float = 1e-30

    # filters
    #: Rates whose ratio is smaller are one rate.
    other_rate_ratio: float = 1.5
    #: Highest cut-off, as a fraction of a topic's rate: a higher one leaves too few samples to
    #: filter.
    cutoff_max_rate_fraction: float = 0.45
    #: Order of the Butterworth low-pass.
    low_pass_order: int = 4
    #: Stamps that stray by less than this fraction of a period count as uniform.
    uniform_step_fraction: float = 0.01
    #: Steps that are searched for the one that most others equal: enough that a majority shows.
    common_step_steps: int = 101

    # grid_rate
    #: Fewest steps in a row that are gaps at a channel's usual rate and make a slower rate,
    slower_min_steps: int = 20
    #: fraction of them that is within the second ratio of their median (readings that come on a
    #: change or in bursts are irregular),
    slower_steady_fraction: float = 0.9
    slower_steady_ratio: float = 1.2
    #: and smallest fraction of the recorded time at such a rate: less is left out as gaps.
    slower_min_time_fraction: float = 0.1
    #: Fewest readings of the slowest channel in a window: mass, friction and how they scatter are
    #: estimated from them.
    window_min_readings: int = 20

    # held_readings
    #: Quantile of the changes between runs that is taken for the resolution.
    resolution_quantile: float = 0.1
    #: Change in steps of the resolution, before a run and after it, from which a channel changes
    #: fast.
    fast_change_steps: float = 1.5
    #: Fewest runs between fast changes that show how long a reading is held.
    held_min_runs: int = 12
    #: Largest fraction of such runs that are single rows if readings are held: it is a half where a
    #: topic is as much slower than its table as `other_rate_ratio` says, and nearly all where noise
    #: repeats itself.
    held_max_single_fraction: float = 0.4
    #: Whatever jitters, readings are held for at least half as long as the median one and for less
    #: than twice as long, but for this fraction of them; what reads pulses is held for any time.
    held_shorter_fraction: float = 0.05
    #: Length of a run, in readings, from which it repeats a reading, as at a stand; in shorter ones
    #: a reading was late, or lost.
    repeated_min_readings: int = 2
    #: Longest time in s that a reading is held: a slower sensor determines no mass, and a force
    #: that a program sets stays as long.
    held_max_s: float = 1.25

    # mounting_guess
    #: Mean specific force that is gravity, in m/s²: outside are other units, or gravity was
    #: removed.
    gravity_range_m_s2: tuple[float, float] = (9.3, 10.3)
    #: Largest tilt in degrees that may be the ground's.
    max_ground_slope_deg: float = 10.0
    #: Roll and pitch are rounded to so many degrees: a level place is level to two degrees.
    tilt_step_deg: float = 5.0
    #: Yaw is rounded to the first of these steps in degrees that exceeds two standard deviations.
    yaw_steps_deg: tuple[float, ...] = (1.0, 5.0, 10.0, 30.0, 90.0)
    #: Fraction of their usual speed below which wheels stand,
    standing_speed_fraction: float = 0.02
    #: if they do for so many ns.
    standing_min_ns: int = 500_000_000
    #: Time in ns over which wheel acceleration and specific force are averaged for the yaw,
    yaw_span_ns: int = 300_000_000
    #: and the fewest such spans.
    yaw_min_spans: int = 20
    #: Smallest correlation of specific force and wheel acceleration that determines a direction.
    yaw_min_correlation: float = 0.5

    # piecewise_constant
    #: Most values of a gear or a switch: the gearboxes of lorries have up to 18 gears.
    step_max_values: int = 24
    #: Largest fraction of its readings that are unlike the one before: a lorry that is read once a
    #: second shifts every four seconds at most.
    step_max_fraction: float = 0.25

    # rates
    #: Steps of so many ns are short compared with all that a machine does.
    fine_step_ns: float = 1e7

    # speed_threshold
    #: Quantile of the readings beside those of 0 that is taken for the threshold,
    threshold_edge_quantile: float = 0.25
    #: and the largest fraction of all readings in motion that are below it.
    threshold_max_below_fraction: float = 0.005
    #: Largest threshold in m/s: wheel pulses and GNSS have 0.1 to 0.8.
    threshold_max_m_s: float = 1.0
    #: A speed without a threshold begins with a usual step of its readings: a threshold exceeds so
    #: many
    threshold_min_steps: float = 3.0
    #: of the step that is this quantile of all.
    threshold_step_quantile: float = 0.9
    #: Fewest starts or stops that show a threshold.
    threshold_min_edges: int = 4
    #: Shortest median duration of the drives, in s: a gate's window (3.2 s at 50 Hz) begins after
    #: the gap, and shorter drives, as of a loader, would be lost.
    threshold_min_drive_s: float = 9.0
    #: Readings of 0 are left out so many s before and after a reading in motion,
    threshold_gap_s: float = 0.1
    #: and so many readings at least: more than a gap that would be interpolated.
    threshold_gap_readings: int = 4

    # timestamps
    #: Largest time in ns by which a header stamp may fall back, and by which two topics' stamps may
    #: lie further apart when they are compared by log time: more is another clock.
    clock_jump_ns: int = 1_000_000_000
    #: Smallest fraction of the messages with a header stamp from which header stamps are used.
    stamped_min_fraction: float = 0.99
    #: Scatter of header stamps, as a fraction of their period, from which they are irregular,
    header_scatter_fraction: float = 0.5
    #: if that of log time is at most this fraction of it.
    log_scatter_ratio: float = 0.25
    #: Fewest stamps that show this.
    scatter_min_stamps: int = 100
    #: Parts of a log, each of which gives the line of a clock drift one point.
    drift_parts: int = 24
    #: Fewest parts for which a standard deviation can be stated,
    drift_min_parts: int = 6
    #: and fewest samples in one.
    drift_part_min_samples: int = 8
    #: Quantile of its latencies that is a part's point: low, but no single sample decides it.
    drift_latency_quantile: float = 0.1
    #: Finest resolution of a recorder's stamps in s, whatever their digits.
    stamp_resolution_s: float = 1e-6


#: The values in use.
LIMITS: Final = SignalLimits()
