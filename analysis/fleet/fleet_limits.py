"""Limits of what is reported of a fleet; no file sets them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class FleetLimits:
    """Limits of what is reported of a fleet; no file sets them.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # daily_figures
    #: Fraction of a recording that the gate accepts at least if it works.
    accepted_min_fraction: float = 0.02
    #: Cycles of which one may be without a mass.
    cycles_per_missing_mass: int = 5
    #: Payloads of a machine up to which they do not show which is far from the others.
    unlike_min_payloads: int = 20
    #: Deviations beyond which a payload is far from the others.
    unlike_payload_std: float = 6.0

    # calibration_steps
    #: Coverage factor of the limits of a change.
    change_coverage_factor: float = 2.0

    # machine_drifts
    #: False alarms that all charts of a machine together may have in a year of daily values.
    false_alarms_per_year: float = 0.5
    #: Allowance of the CUSUM, in standard deviations: half of the shift that it finds soonest.
    cusum_allowance_std: float = 0.25
    #: Deviations that a value counts for at most: a day with a broken log is no drift.
    cusum_max_std: float = 3.0
    #: Fewest values that show how days are correlated,
    correlation_min_values: int = 20
    #: and their largest correlation.
    max_correlation: float = 0.9
    #: Fewest values that have a deviation to compare with.
    deviation_min_values: int = 3
    #: States of the Markov chain; twice as many change a limit by less than a hundredth.
    cusum_states: int = 100


#: The values in use.
LIMITS: Final = FleetLimits()
