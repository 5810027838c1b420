"""Limits of calibrating and of checking a calibration that no campaign file sets."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class CampaignRunLimits:
    """Limits of calibrating and of checking a calibration that no campaign file sets.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # apply_evidence
    #: Differing settings that an error names, at most.
    max_settings: int = 2

    # calibrate_campaign
    #: Difference in kg that a replay on another computer may have: processors differ in the last
    #: bits.
    replay_tolerance_kg: float = 1e-6
    #: Faults of a campaign that an error names, at most.
    max_faults: int = 3

    # campaign_runs
    #: Characters that evidence keeps of the text of a loss.
    loss_characters: int = 2000
    #: Characters that evidence keeps of a machine's serial number.
    machine_id_characters: int = 64

    # compare_logs
    #: Files and folders that are searched for logs, at most.
    searched_files: int = 100_000
    #: Depth of nested folders that are searched for logs.
    searched_depth: int = 8
    #: Readings, terms or runs that differ and get a finding each; further ones are counted.
    max_logs: int = 10
    #: Difference of a nuisance in a replay on another computer, in prior standard deviations.
    term_tolerance_1: float = 1e-6
    #: Largest relative difference of numbers that differ only by rounding.
    last_bits_1: float = 1e-9
    #: Characters of a value that a fault quotes.
    quoted_characters: int = 120


#: The values in use.
LIMITS: Final = CampaignRunLimits()
