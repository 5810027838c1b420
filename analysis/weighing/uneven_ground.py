"""Terms of uneven ground: grade and rolling resistance along the way, by load and direction.

A hauling machine starts loaded where it digs, and empty where it dumps. The effect of slope and
rolling resistance there, and of their change along the way, recurs with the load at every start, so
that more starts do not average it out, and a model without it would attribute it to the mass.
Therefore each direction has a force along the way for loaded starts and one for empty ones, linear
between a few places.

On its way back the machine drives over the ground of its haul. As a function of the distance from
the dump, the change of rolling resistance along that route is one force for all loads, in
proportion to the weight: a loaded machine accelerates across a boundary between two grounds where
an empty one cruises. So is its grade, but the machine that climbs it on its haul descends it on its
way back.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.nuisances import (
    Nuisance,
)
from estimators.interpreted import compiled_inline, compiled_unless_short_log

#: Budget entry that combines these terms.
BY_GROUND: Final = "ground"


@dataclass(frozen=True)
class _DrivingDirection:
    """A direction of driving.

    Attributes:
        name: name of the direction in the names of terms.
        sign: 1 forwards, -1 in reverse.
    """

    name: str
    sign: float

    def make_terms(self) -> list[Nuisance]:
        """Terms: by load where a start begins, then along the way for all loads and by load."""
        places = list(pairwise(LIMITS.loading_places_m))
        found = [
            self._make_loaded_minus_empty_term(
                "",
                lambda m: np.ones(m.speed.size),
                self._compute_prior_std_at_loading_place_newtons,
            )
        ]
        for start_m, end_m in places:
            name, column = (
                f"_{start_m:.0f}_{end_m:.0f}m",
                _make_zero_to_one_ramp_over_distance(start_m, end_m),
            )
            width = make_random_walk_prior_std_function(end_m - start_m)
            found.append(
                self._make_uneven_ground_term(
                    name, column, width, "change of the ground force along this stretch"
                )
            )
            found.append(self._make_loaded_minus_empty_term(name, column, width))
        return found

    def _make_loaded_minus_empty_term(
        self,
        name: str,
        compute_column: Callable[[ColumnInputs], Floats],
        make_prior_std: Callable[[MotionSamples, PriorSettings], float],
    ) -> Nuisance:
        """Term of the difference between loaded and empty starts."""
        meaning = "difference of the ground force between loaded and empty starts"
        return self._make_uneven_ground_term(
            f"{name}_by_load",
            lambda m: compute_column(m) * m.load_contrast,
            make_prior_std,
            meaning,
        )

    def _make_uneven_ground_term(
        self,
        name: str,
        compute_column: Callable[[ColumnInputs], Floats],
        make_prior_std: Callable[[MotionSamples, PriorSettings], float],
        meaning: str,
    ) -> Nuisance:
        return Nuisance(
            f"ground_{self.name}{name}",
            "N",
            lambda m: restrict_column_to_direction(compute_column(m), m.direction, self.sign),
            make_prior_std,
            f"{meaning}, {self.name}",
            "more cycles; a pitch channel; even ground",
            applies=self._does_motion_drive_in_direction,
            by_load=True,
            source=BY_GROUND,
        )

    @staticmethod
    def _compute_prior_std_at_loading_place_newtons(
        motion: MotionSamples, priors: PriorSettings
    ) -> float:
        return priors.ground_share * motion.empty_weight_N

    def _does_motion_drive_in_direction(self, motion: MotionSamples) -> bool:
        ways = motion.direction[motion.is_fittable] == self.sign
        return float(ways.mean()) > LIMITS.direction_min_fraction


def _make_zero_to_one_ramp_over_distance(
    start_m: float, end_m: float
) -> Callable[[ColumnInputs], Floats]:
    """Make the column that rises from 0 to 1 between two travelled distances."""
    return lambda m: _evaluate_linear_ramp_at_positions(m.travelled_m, start_m, end_m)


@compiled_inline
def _evaluate_linear_ramp(position: float, start_m: float, end_m: float) -> float:
    """Value at a position of the ramp from 0 at `start_m` to 1 at `end_m`, constant outside."""
    return min(max((position - start_m) / (end_m - start_m), 0.0), 1.0)


@compiled_unless_short_log
def _evaluate_linear_ramp_at_positions(positions: Floats, start_m: float, end_m: float) -> Floats:
    """Ramp from 0 at `start_m` to 1 at `end_m`, at each position, in the shape of `positions`."""
    out = np.empty(positions.size)
    for k in range(out.size):
        out[k] = _evaluate_linear_ramp(positions[k], start_m, end_m)
    return out


@compiled_unless_short_log
def evaluate_scaled_ramp(
    scale: Floats, positions: Floats, start_m: float, end_m: float, ratio: float
) -> Floats:
    """Ramp at each position, multiplied by `ratio` and by `scale` (n,)."""
    out = np.empty(positions.size)
    for k in range(out.size):
        out[k] = scale[k] * (_evaluate_linear_ramp(positions[k], start_m, end_m) * ratio)
    return out


@compiled_unless_short_log
def restrict_column_to_direction(column: Floats, direction: Floats, sign: float) -> Floats:
    """Column (n,) in one driving direction, 0 in the other."""
    out = np.zeros(column.size)
    for k in range(out.size):
        if direction[k] == sign:
            out[k] = sign * column[k]
    return out


def make_random_walk_prior_std_function(
    length_m: float,
) -> Callable[[MotionSamples, PriorSettings], float]:
    """Make the function of the prior std of the change over a length, by a random walk."""
    share = compute_relative_random_walk_std(length_m)
    return lambda motion, priors: priors.ground_change_share * share * motion.empty_weight_N


def compute_relative_random_walk_std(length_m: float) -> float:
    """Standard deviation of a random walk over a length, over that for the reference length."""
    return float(np.sqrt(length_m / LIMITS.ground_change_m))


def _make_route_term(route_part: int) -> Nuisance:
    """Term of the change of rolling resistance along one part of the route."""
    return Nuisance(
        f"ground_route_{route_part + 1}_of_{LIMITS.route_parts}",
        "N",
        lambda m: _compute_route_ramp(m, m.direction_times_relative_weight, route_part),
        lambda e, s: s.ground_route_share * e.empty_weight_N,
        "change of rolling resistance along the route, over ten metres",
        "more cycles; even ground",
        by_load=True,
        source=BY_GROUND,
    )


def _compute_route_ramp(m: ColumnInputs, scale: Floats, route_part: int) -> Floats:
    """Random walk along one part of the route, (n,), multiplied by `scale`."""
    start, end = route_part / LIMITS.route_parts, (route_part + 1) / LIMITS.route_parts
    ratio = compute_relative_random_walk_std(m.route_length_m / LIMITS.route_parts)
    return evaluate_scaled_ramp(scale, m.route_1, start, end, ratio)


def _may_motion_have_unmeasured_grade(motion: MotionSamples) -> bool:
    """Whether gravity is not measured, and the machine reverses: else it may drive a loop."""
    reverse = float((motion.direction[motion.is_fittable] < 0.0).mean())
    least = LIMITS.direction_min_fraction
    return not motion.has_measured_gravity and least < reverse < 1.0 - least


def _make_grade_term(name: str, route_part: int | None) -> Nuisance:
    """Term of the grade at the dump, or of its change along one part of the route."""

    def compute_grade_column(m: ColumnInputs) -> Floats:
        if m.heading_from_dump is None:
            return np.zeros(m.speed.size)
        weight = m.heading_from_dump * (1.0 + m.relative_load)
        return weight if route_part is None else _compute_route_ramp(m, weight, route_part)

    return Nuisance(
        f"grade_{name}",
        "N",
        compute_grade_column,
        lambda e, s: s.grade_change_share * e.empty_weight_N,
        "grade along the route, which the machine climbs one way and descends the other",
        "a pitch channel; even ground",
        applies=_may_motion_have_unmeasured_grade,
        by_load=True,
        source=BY_GROUND,
    )


#: Added after the other terms.
GROUND: Final = (
    *_DrivingDirection("forward", 1.0).make_terms(),
    *_DrivingDirection("reverse", -1.0).make_terms(),
    *map(_make_route_term, range(LIMITS.route_parts)),
)
#: Added after these; not chosen by their evidence (record 0166).
GRADE: Final = (
    _make_grade_term("at_dump", None),
    *(_make_grade_term(f"{k + 1}_of_{LIMITS.route_parts}", k) for k in range(LIMITS.route_parts)),
)


def does_load_search_include_ground(motion: MotionSamples) -> bool:
    """Whether the ground is fitted while the loads are searched, or once they are known."""
    return motion.manoeuvre_count >= LIMITS.ground_min_manoeuvres
