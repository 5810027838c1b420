"""Limits of calibrating and of checking a calibration that no campaign file sets."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class CampaignRunLimits:
    """Limits of calibrating and of checking a calibration that no campaign file sets.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # apply_evidence
    #: Settings that differ and are named.
    max_settings: int = 2

    # calibrate_campaign
    #: Difference in kg by which a replay elsewhere may be off: other processors have other last
    #: bits.
    replay_tolerance_kg: float = 1e-6
    #: Faults of a campaign that an error names.
    max_faults: int = 3

    # campaign_runs
    #: Characters of a loss that evidence keeps,
    loss_characters: int = 2000
    #: and of a machine's number.
    machine_id_characters: int = 64

    # compare_logs
    #: Files that are searched for logs,
    searched_files: int = 100_000
    #: depth of folders,
    searched_depth: int = 8
    #: and logs that a fault names.
    max_logs: int = 10
    #: Difference of a nuisance elsewhere, over its prior.
    term_tolerance_1: float = 1e-6
    #: Relative difference of numbers that differ by rounding alone.
    last_bits_1: float = 1e-9
    #: Characters of a value that a fault quotes.
    quoted_characters: int = 120


#: The values in use.
LIMITS: Final = CampaignRunLimits()
