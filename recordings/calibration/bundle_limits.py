"""Bounds of a stranger's evidence, and of what is said of it."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class BundleLimits:
    """Bounds of a stranger's evidence, and of what is said of it.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # bundle_checks
    #: Entries that are no bundle's and are named.
    max_foreign_entries: int = 20

    # bundle_folder
    #: Files of a bundle; one of a campaign of many runs has some hundred.
    bundle_max_files: int = 4096
    #: Bytes of a file that is held in memory,
    held_file_bytes: int = 32 << 20
    #: and bytes that are read at once of one that is not.
    chunk_bytes: int = 1 << 20

    # calibration_plots
    #: Height of a figure of the report, in units of the drawing,
    figure_height: int = 232
    #: points of a curve,
    curve_points: int = 41
    #: and height of a row.
    row_height: float = 18.0

    # calibration_text
    #: Logs of a list that are named.
    max_logs: int = 12
    #: Fraction of what is reported beyond which β is most of it; below, it is a correction.
    large_correction_fraction: float = 0.5

    # campaign_faults
    #: Time in s by which the clocks of two computers may differ.
    clock_difference_s: int = 300
    #: Time in s that two logs of one machine may have in common: begins are stated in whole
    #: seconds, and a recorder that splits its logs may write a message twice.
    common_time_s: float = 2.0

    # evidence_document
    #: Characters of a stranger's text that are repeated.
    quoted_characters: int = 60

    # recomputation
    #: Relative difference by which another processor or library has other last bits.
    last_bits_1: float = 1e-9
    #: Differences of a list that are named.
    max_differences: int = 5
    #: Characters of a library's fault that are passed on.
    fault_characters: int = 200

    # untrusted_files
    #: Time in s that reading the tables may take.
    tables_max_s: float = 60.0
    #: Bytes of JSON that tables may become.
    tables_output_bytes: int = 256 << 20
    #: Bytes of tables whose reading is kept: those of evidence have some kB, and are read again
    #: with the evidence after it and with the chain.
    kept_tables_bytes: int = 1 << 20
    #: Time in s that recordings of long logs may take.
    recordings_max_s: float = 900.0
    #: Bytes of JSON that a process may answer with.
    answer_bytes: int = 64 << 20
    #: Characters of a difference that are shown,
    difference_characters: int = 40
    #: and of what stands before it.
    context_characters: int = 12

    # timestamp
    #: Bytes of a response that are read; one has some thousand.
    response_bytes: int = 1 << 20


#: The values in use.
LIMITS: Final = BundleLimits()
