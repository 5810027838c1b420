"""Numbered procedures of a calibration: how the results of its logs are combined.

Evidence states the number, so that a later version recomputes it by the same procedure.
"""

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

ProcedureNumber = Literal[1, 2, 3]


class Procedure(NamedTuple):
    """Rules that differ between procedures.

    Attributes:
        factors_in_common: whether the machine file's uncertainty of gain, share and radius counts
            in the common error of the readings; otherwise the line absorbs it.
        terms_tested_singly: whether each nuisance is tested at 5 % for variation between logs;
            otherwise the 5 % are for all nuisances together.
        known_loads_kept: whether a log with one known load is weighed as one load; otherwise load
            states are searched for as in any other log.
    """

    factors_in_common: bool
    terms_tested_singly: bool
    known_loads_kept: bool


PROCEDURES: Final[Mapping[ProcedureNumber, Procedure]] = {
    1: Procedure(factors_in_common=True, terms_tested_singly=True, known_loads_kept=False),
    2: Procedure(factors_in_common=False, terms_tested_singly=False, known_loads_kept=False),
    3: Procedure(factors_in_common=False, terms_tested_singly=False, known_loads_kept=True),
}
#: Procedure of new evidence; evidence without a number was made by the first.
PRESENT_NUMBER: Final[ProcedureNumber] = 3
PRESENT_PROCEDURE: Final = PROCEDURES[PRESENT_NUMBER]
