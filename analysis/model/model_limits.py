"""Built-in limits of machine files, names and answers, which no file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ModelLimits:
    """Built-in limits of machine files, names and answers, which no file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # fingerprint
    #: Rows that are hashed together: bounds the memory, and is a multiple of the 8 bits of a byte.
    hashed_rows: int = 1 << 20
    #: Rows from which a column is hashed in a thread, which else takes longer to start.
    threaded_rows: int = 100_000
    #: Hexadecimal digits that a person compares.
    compared_digits: int = 12

    # machine
    #: Ratio to the wheel's radius, either way, from which a scale is meant as one,
    same_wheel_ratio: float = 0.5
    #: and relative difference from which it is another: tyres wear and sink in by less.
    wheel_difference_1: float = 0.08
    #: Relative distance within which a scale is a unit of speed.
    same_unit_1: float = 1e-3

    # physical_units
    #: Letters of a unit that no letter before it turns into another one: cKmh is none, cNm is.
    clear_unit_letters: int = 3
    #: Words of a unit behind a name: rad_s2, N_m.
    suffix_words: int = 3

    # verdict
    #: Fraction of a limit from which on a number that passes is near it: a fifth of the way is
    #: left.
    near_limit_fraction: float = 0.8


#: The values in use.
LIMITS: Final = ModelLimits()
