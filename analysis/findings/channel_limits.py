"""Limits of the causes that the readings of a channel show."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ChannelLimits:
    """Limits of the causes that the readings of a channel show.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # sampling_causes
    #: Fraction of a topic's steps that are missing before it counts.
    missing_step_fraction: float = 0.002
    #: Hole of all topics in ns that is a pause between two logs,
    recorder_pause_ns: int = 2_000_000_000
    #: but for its edges, in ns.
    recorder_pause_edge_ns: int = 100_000_000
    #: Scatter of a topic's steps over its period that matters if the stamps are wrong,
    uneven_steps_wrong_stamps: float = 0.15
    #: if the readings do not show whether they are,
    uneven_steps: float = 0.3
    #: and if they show that the stamps are right.
    uneven_steps_right_stamps: float = 1.0
    #: Standard deviations from which readings show whether they were taken at their stamps.
    stamp_fidelity_std: float = 4.0
    #: Readings in each of the two means of a slope: steady beside noise, and short beside a start.
    slope_rows: int = 8
    #: Smallest jump of a clock, in s,
    clock_jump_s: float = 0.003
    #: and in standard deviations of the latency.
    clock_jump_std: float = 8.0
    #: Parts of a log whose latencies are compared.
    latency_parts: int = 40
    #: Smallest drift of a clock in standard deviations,
    clock_drift_std: float = 6.0
    #: and in s over the log.
    clock_drift_s: float = 0.003

    # the two sides
    #: Smallest difference of the sides: sound machines have up to 5 %;
    unlike_sides_1: float = 0.07
    #: and of hard starts beyond soft ones, where sound machines have none.
    unlike_slip_1: float = 0.03
    #: A side whose speed is within this of the accelerometer is right,
    right_side_1: float = 0.02
    #: if the other one is off by this.
    wrong_side_1: float = 0.04

    # accelerometer_response
    #: Length in s of the means of which the gain of the accelerometer is fitted,
    gain_span_s: float = 0.1
    #: and their fewest.
    gain_min_spans: int = 50
    #: Mean square that a pitch of another sign or unit leaves of the accelerometer beside the
    #: wheels, over what it leaves as it is and what no pitch leaves, below which it is wrong: 0.03
    #: and less in drives on slopes of 5 %,
    pitch_left_1: float = 0.25
    #: largest difference from one of the slope of gravity by that pitch: a pitch in per cent is
    #: 0.57 of one in degrees,
    pitch_slope_tolerance_1: float = 0.25
    #: and what is left as it is, r.m.s. in m/s²: a slope of 0.3°.
    pitch_min_rest_m_s2: float = 0.05
    #: Smallest fraction that is motion of what the wheels' acceleration shows; the rest is its
    #: noise,
    gain_motion_fraction: float = 0.3
    #: whose power is known to this fraction.
    gain_noise_u_1: float = 0.2

    # channel_causes
    #: Time in s for which a channel repeats itself, all in all, from which it counts.
    frozen_total_s: float = 0.3
    #: Part of its largest reading from which a frozen speed is at its limit: to rounding.
    stuck_at_largest_1: float = 0.999
    #: Fraction of the readings that accumulate at an extreme if it clips them.
    clipped_fraction: float = 0.001
    #: Fraction of readings in motion that repeat the one before if noise is below the resolution.
    repeated_fraction: float = 0.1
    #: Fraction of the steps that are multiples of the least one if that is the resolution,
    whole_step_fraction: float = 0.95
    #: and the fewest steps that show it.
    resolution_min_steps: int = 200
    #: Deviations of its neighbourhood by which a spike is off both neighbours,
    spike_std: float = 8.0
    #: which agree within this fraction of that.
    spike_neighbour_fraction: float = 0.4
    #: Deviations of a spike that is alone, over those: jolts of sound machines reach 11.
    single_spike_ratio: float = 1.7
    #: Deviations that a spike beside readings without noise counts for at most.
    spike_max_std: float = 1000.0
    #: Readings of a neighbourhood whose deviation is taken.
    spike_block_readings: int = 200
    #: Standard deviations from which force and acceleration jump together at a jolt,
    jolt_std: float = 5.0
    #: within so many periods of each other,
    jolt_periods: float = 1.5
    #: from the median of so many ns on either side.
    jolt_around_ns: int = 150_000_000
    #: Samples of the grid beside a spike that are not fitted.
    spike_margin_samples: int = 15
    #: Time in ns by which a channel may come to its reading of a stand before the speed does, or
    #: leave it after it.
    stand_edge_ns: int = 200_000_000
    #: Fraction of the samples of a stand whose force is that of an idle drive.
    idle_samples_fraction: float = 0.9
    #: Fraction of the log for which a channel repeats itself from which it is dead.
    dead_fraction: float = 0.5
    #: Time in s over which the resistance and the difference of the sides' speeds are averaged: a
    #: part of a curve,
    turn_mean_s: float = 0.5
    #: fewest such means: five curves or so,
    turn_min_blocks: int = 30
    #: largest fraction of the difference that speed and force explain: all of it where wheels are
    #: unlike or slip on one side, a quarter at most in curves,
    turn_max_explained_by_straight_1: float = 0.5
    #: fraction of the residual variance from which turns explain other findings,
    turn_mostly_explained_1: float = 0.5
    #: and the fraction of the residual variance that follows the difference if the machine turns:
    #: 0.7 to 0.97 in simulated carts whose curves scrub, 0.2 in a real machine that skids to steer,
    #: below 0.02 in machines that drive straight or roll through curves.
    turn_explained_1: float = 0.15


#: The values in use.
LIMITS: Final = ChannelLimits()
