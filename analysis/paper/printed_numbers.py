"""Numbers printed in the paper's tables and claims, each written once."""

from collections.abc import Sequence
from statistics import pstdev
from typing import Final

#: The paper's methods in its order.
METHODS: Final[tuple[str, ...]] = ("ls", "rls", "fgls", "tls")

MASS_KG: Final = 3614.0  # section 4.3, without load
LOAD_RANGE_KG: Final = 250.0  # section 4.3, five drums of 50 kg
#: Error of a constant that ignores every measurement: the deviation of the loads from their mean.
CONSTANT_KG: Final = pstdev(50.0 * drums for drums in range(6))
PERIOD_S: Final = 15.0  # section 4.2, T_f
RESPONSE_S: Final = 5.0  # section 4.2, T

#: Table 1: RMS error of the mass in kg, in simulation, by window length in s.
TABLE_1_KG: Final = {
    2.0: (79.46, 50.26, 79.99, 189.95),
    3.0: (116.24, 72.48, 115.61, 310.4),
    4.0: (34.86, 18.72, 34.79, 84.82),
    5.0: (17.91, 56.59, 18.47, 68.74),
    6.0: (14.26, 4.27, 14.04, 92.11),
    7.0: (92.31, 5.45, 93.79, 187.35),
    8.0: (32.37, 18.55, 32.17, 12.24),
    9.0: (44.91, 31.56, 45.25, 64.72),
    10.0: (11.66, 3.89, 11.62, 3.25),
    15.0: (26.2, 54.09, 26.03, 48.42),
    20.0: (9.35, 9.29, 9.34, 12.38),
    25.0: (1.58, 13.52, 1.63, 23.42),
    30.0: (1.22, 16.32, 1.45, 23.65),
}
#: Table 2: slope and offset (kg) of the calibration (19).
TABLE_2: Final = {
    "alpha_1": (0.146, 0.140, 0.146, 0.191),
    "beta_kg": (3401.4, 3459.9, 3401.1, 3208.8),
}
#: Table 3: RMS error of the calibrated mass in kg by threshold of (11) in nat.
TABLE_3_KG: Final = {
    0.5: (22.6, 36.4, 22.6, 25.6),
    0.7: (5.1, 42.6, 4.9, 21.3),
    0.9: (4.9, 10.4, 4.9, 21.3),
    1.1: (20.4, 11.1, 20.4, 31.7),
    1.3: (15.2, 9.8, 21.8, 19.9),
    1.5: (30.7, 10.7, 26.2, 30.6),
}
#: Table 4: the same by window length in samples.
TABLE_4_KG: Final = {
    200.0: (11.8, 23.2, 11.8, 24.2),
    300.0: (4.9, 10.9, 4.9, 19.5),
    400.0: (4.9, 10.4, 4.9, 24.0),
    500.0: (17.5, 12.1, 17.5, 31.3),
    600.0: (17.5, 12.4, 67.1, 28.2),
    700.0: (15.1, 12.4, 63.7, 28.6),
}

#: Abstract: the RMS error is below this fraction of the machine's mass.
RMS_SHARE: Final = 0.01
#: Section 5, "on average … with a 95 % confidence level", shares of the machine's mass.
SIMULATION_ERROR: Final = (0.0008e-2, 0.03e-2)
EXPERIMENT_ERROR: Final = (0.15e-2, 0.13e-2)
#: Section 5: at least this much smaller than recursive least squares without the criterion.
REDUCTION: Final = 0.80


def pair_table_values_with_methods(table_row: Sequence[float] | None) -> dict[str, float]:
    """Values of a table's row by method; empty for a row that the table lacks."""
    return {} if table_row is None else dict(zip(METHODS, table_row, strict=True))
