"""Bounds of untrusted evidence, and of what is reported about it."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class BundleLimits:
    """Bounds of untrusted evidence, and of what is reported about it.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # bundle_checks
    #: Most entries that do not belong in a bundle and are named.
    max_foreign_entries: int = 20

    # bundle_folder
    #: Most files of a bundle; a campaign of many runs has some hundred.
    bundle_max_files: int = 4096
    #: Most bytes of a file that is kept in memory.
    held_file_bytes: int = 32 << 20
    #: Bytes of a file that are read at once.
    chunk_bytes: int = 1 << 20

    # calibration_plots
    #: Height of a figure of the report, in units of the drawing.
    figure_height: int = 232
    #: Number of points of a curve.
    curve_points: int = 41
    #: Height of a row of a figure, in units of the drawing.
    row_height: float = 18.0

    # calibration_text
    #: Most logs that a sentence names.
    max_logs: int = 12
    #: Fraction of the reported mass beyond which β is most of it, and not a mere correction.
    large_correction_fraction: float = 0.5

    # campaign_faults
    #: Time in s by which the clocks of two computers may differ.
    clock_difference_s: int = 300
    #: Time in s by which two logs of one machine may overlap: starts are stated in whole seconds,
    #: and a recorder that splits its logs may write a message twice.
    common_time_s: float = 2.0

    # evidence_document
    #: Characters of untrusted text that are quoted, at most.
    quoted_characters: int = 60

    # recomputation
    #: Relative difference of numbers that other processors or libraries may cause by rounding.
    last_bits_1: float = 1e-9
    #: Most differences that are named.
    max_differences: int = 5
    #: Characters of a library's error that are quoted, at most.
    fault_characters: int = 200

    # untrusted_files
    #: Time in s that reading the tables may take.
    tables_max_s: float = 60.0
    #: Most bytes of the JSON to which tables are converted.
    tables_output_bytes: int = 256 << 20
    #: Most bytes of tables whose content is cached: those of evidence have some kB, and are read
    #: again with the following evidence and with the chain.
    kept_tables_bytes: int = 1 << 20
    #: Time in s that reading recordings may take; those of long logs take minutes.
    recordings_max_s: float = 900.0
    #: Most bytes of JSON that a reader's process may return.
    answer_bytes: int = 64 << 20
    #: Characters of differing texts that are quoted, at most.
    difference_characters: int = 40
    #: Characters before a difference that are quoted with it.
    context_characters: int = 12

    # timestamp
    #: Most bytes of a response, which has some thousand.
    response_bytes: int = 1 << 20


#: The values in use.
LIMITS: Final = BundleLimits()
