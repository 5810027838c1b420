"""Limits of replays of several logs or settings."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class RunLimits:
    """Limits of replays of several logs or settings.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # run_logs
    #: Interval in s between checks of the machine file, longer than an editor takes to write it.
    check_interval_s: float = 0.2
    #: Checks after which a missing file counts as removed; an editor replaces a file faster.
    checks_until_removed: int = 10

    # sweep_settings
    #: Most points of a grid: more would take days of replays, and are a mistake.
    max_grid_points: int = 10_000
    #: Fewest loads of a calibration campaign: with fewer, only raw masses are compared with the
    #: truth.
    calibration_min_loads: int = 3


#: The values in use.
LIMITS: Final = RunLimits()
