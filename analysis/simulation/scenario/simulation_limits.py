"""Limits and steps of the simulation that no scenario sets."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class SimulationLimits:
    """Limits and steps of the simulation that no scenario sets.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # log_drive
    #: Steps in the lag of a drive that a pedal follows; forces interpolated in one are 0.1 % off.
    pedal_steps_per_lag: int = 80

    # machine_driver
    #: Longest step in s: a hundredth of the lag of the paper's machine; forces interpolated in it
    #: are 0.2 N off.
    step_s: float = 0.001
    #: Steps in a period of the fastest thing that swings,
    steps_per_swing: int = 40
    #: and in the lag of the valves.
    steps_per_lag: int = 4
    #: Longest stop of a driven machine, in s.
    driver_max_stop_s: float = 120.0
    #: Highest speed in m/s: no loader is faster, so that beyond it a scenario is a slip of the pen,
    #: and a stop takes forever.
    top_speed_m_s: float = 50.0
    #: Step in s of a throttle that changes all along.
    wave_step_s: float = 0.001
    #: Steps of a half turn.
    half_turn_steps: int = 1000
    #: Shortest cruise of a start, in s.
    min_cruise_s: float = 0.2

    # shift_drive
    #: Distance in m before the pile, and before the dump, at which the machine stops.
    pile_reach_m: float = 1.0
    #: Time in s that the throttle is open in a start of a haul,
    haul_throttle_s: float = 3.0
    #: and on a short way.
    short_throttle_s: float = 1.5
    #: Time in s at full throttle after the start into a pile, whose resistance grows from the first
    #: contact on.
    digging_cruise_s: float = 0.3
    #: Shortest time in s that the machine idles.
    min_idle_s: float = 10.0
    #: Angles of boom and bucket that pour a part, positive up, in rad.
    pour_angles_rad: tuple[float, float] = (0.6, 0.1)
    #: Time in s after which a filled bucket is lifted.
    lift_s: float = 2.0

    # solve_trial
    #: Longest stop of a trial, in s, far beyond any: a scenario keeps below 50 m/s and brakes with
    #: at least 0.1 m/s².
    trial_max_stop_s: float = 86_400.0
    #: Changes of friction in no time from which no motion obeys it.
    max_changes_at_once: int = 20

    # stiction
    #: Smallest friction, in N or N·m: less is lost in rounding before it holds anything.
    min_grip: float = 1e-6

    # trial_limits
    #: Highest yaw rate, in rad/s, likewise.
    top_yaw_rate_rad_s: float = 10.0
    #: Smallest deceleration by the brakes, in m/s², with which a stop ends.
    min_braking_m_s2: float = 0.1

    # sensors
    #: Step of a sensor's filter at most, in s: between two steps a signal is a straight line.
    filter_step_s: float = 0.001
    #: Steps in its time constant at least.
    filter_steps_per_lag: int = 10

    # shift_logs
    #: Time in s that sensors look back at most.
    sensor_look_back_s: float = 60.0
    #: Largest distance from the even places at which logs part, in lengths of a log.
    log_unevenness: float = 0.1
    #: Smallest fraction of what a torn log loses at most that it loses.
    min_damage_fraction: float = 0.05


#: The values in use.
LIMITS: Final = SimulationLimits()
