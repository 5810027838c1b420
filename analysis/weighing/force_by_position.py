"""Terms of a position-dependent force, on a short path that is driven back and forth.

The force of a spring, a cable, a cam or the weight of an arm is correlated with the acceleration,
which is largest at the ends of the path. The part that is due to weight grows with the load.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.motion_samples import Floats
from analysis.weighing.nuisances import (
    Nuisance,
)
from analysis.weighing.weighing_limits import LIMITS

#: Budget entry that combines these terms.
BY_PLACE: Final = "place"


def make_position_proportional_force_column(relative_position: Floats) -> Floats:
    """Column (n,) of a force proportional to the position; 1 at the end of the path."""
    return 2.0 * relative_position


def evaluate_half_wave_cosine(relative_position: Floats, half_waves: int) -> Floats:
    """Cosine (n,) with `half_waves` half waves over the path."""
    return np.cos(np.pi * half_waves * (relative_position + 0.5))


def _make_position_wave_term(half_waves: int) -> Nuisance:
    """Term of a force that varies over the path as a cosine of `half_waves` half waves."""
    return Nuisance(
        f"place_{half_waves}",
        "N",
        lambda m: evaluate_half_wave_cosine(m.path_position_1, half_waves),
        lambda e, s: s.place_share * e.force_95_percentile_newtons / half_waves,
        "a force that depends on the place on a short path: gravity, a cable, a cam",
        "strokes at different accelerations over the same path",
        applies=lambda e: e.is_short_path_bench_log,
        source=BY_PLACE,
    )


def _make_load_proportional_term(term: Nuisance) -> Nuisance:
    """Term of the part of `term` that is proportional to the load."""

    def make_load_column(m: ColumnInputs) -> Floats:
        return term.column(m) * m.relative_load

    return replace(
        term,
        name=f"{term.name}_by_load",
        column=make_load_column,
        meaning=f"{term.meaning}; proportional to the load",
        by_load=True,
    )


_OF_EVERY_LOAD: Final = (
    Nuisance(
        "spring",
        "N",
        lambda m: make_position_proportional_force_column(m.path_position_1),
        lambda e, s: s.place_share * e.force_95_percentile_newtons,
        "a force in proportion to the place on a short path, at its ends: a spring, gravity",
        "strokes at different accelerations over the same path",
        applies=lambda e: e.is_short_path_bench_log,
        source=BY_PLACE,
    ),
    *map(_make_position_wave_term, range(1, LIMITS.path_half_waves + 1)),
)
#: Added after the nuisances that every log may have.
PLACE: Final = (*_OF_EVERY_LOAD, *map(_make_load_proportional_term, _OF_EVERY_LOAD))


def make_position_force_columns(relative_position: Floats) -> Floats:
    """(n, terms) columns of a spring and of the half waves, at positions on the path."""
    waves = (
        evaluate_half_wave_cosine(relative_position, half_waves)
        for half_waves in range(1, LIMITS.path_half_waves + 1)
    )
    return np.column_stack([make_position_proportional_force_column(relative_position), *waves])


def make_position_force_slopes(relative_position: Floats) -> Floats:
    """(n, terms) derivatives of `make_position_force_columns` with respect to the position."""
    numbers = np.pi * np.arange(1, LIMITS.path_half_waves + 1)
    waves = -numbers * np.sin(numbers * (relative_position[:, None] + 0.5))
    return np.column_stack(
        [
            np.full(relative_position.size, make_position_proportional_force_column(np.ones(1))),
            waves,
        ]
    )
