"""Bounds of a digital calibration certificate that is read."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class DccLimits:
    """Bounds of a digital calibration certificate that is read.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # dcc_document
    #: Bytes of a certificate: a hundred weights take 0.3 MB, and an embedded PDF a few MB.
    certificate_bytes: int = 16 << 20
    #: Elements of a certificate, for the same reason.
    certificate_elements: int = 200_000

    # dcc_masses
    #: Items that an error names as choices.
    max_items: int = 12

    # dcc_quantity
    #: Characters of a number, of which no certificate needs more.
    number_characters: int = 40
    #: Relative uncertainty beyond which a weight is a misread unit,
    weight_max_u_1: float = 0.1
    #: and mass in kg beyond which it is one.
    weight_max_kg: float = 1e6
    #: Coverage factor beyond which none is of an interval of 99.99 %, even with two degrees of
    #: freedom.
    max_coverage_factor: float = 100.0
    #: Values of a list; the largest sets have about 30 weights.
    max_values: int = 1000


#: The values in use.
LIMITS: Final = DccLimits()
