"""Bounds of a digital calibration certificate that is read."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class DccLimits:
    """Bounds of a digital calibration certificate that is read.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # dcc_document
    #: Most bytes of a certificate: a hundred weights take 0.3 MB, and an embedded PDF a few MB.
    certificate_bytes: int = 16 << 20
    #: Most elements of a certificate, likewise.
    certificate_elements: int = 200_000

    # dcc_masses
    #: Most items that an error names as choices.
    max_items: int = 12

    # dcc_quantity
    #: Most characters of a number.
    number_characters: int = 40
    #: Relative uncertainty beyond which the unit of a weight must be wrong.
    weight_max_u_1: float = 0.1
    #: Mass in kg beyond which the unit of a weight must be wrong.
    weight_max_kg: float = 1e6
    #: Coverage factor that even an interval of 99.99 % with two degrees of freedom does not exceed.
    max_coverage_factor: float = 100.0
    #: Most values of a list; the largest sets have about 30 weights.
    max_values: int = 1000


#: The values in use.
LIMITS: Final = DccLimits()
