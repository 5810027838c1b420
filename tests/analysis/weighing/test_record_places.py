"""Records of a bench, none of which says where it began, are placed by the force at each place."""

import numpy as np
import pytest

from analysis.weighing.force_by_position import (
    make_position_force_columns,
    make_position_force_slopes,
)
from analysis.weighing.record_places import estimate_record_position_offsets

TURNS = np.linspace(0.0, 40.0 * np.pi, 4000)
#: Places and accelerations of one record of strokes to and fro.
PLACE_1, ACCELERATION = 0.4 * np.sin(TURNS), -1.5 * np.sin(TURNS + 0.7)


def force_at(place_1: np.ndarray) -> np.ndarray:
    """A spring and a weight whose share changes along the path."""
    return 30.0 * place_1 + 12.0 * np.cos(3.0 * place_1)


@pytest.mark.parametrize("off_1", [-0.15, 0.0, 0.02, 0.2])
def test_a_record_that_began_elsewhere_is_moved_to_where_its_force_is_that_of_the_first(
    off_1: float,
) -> None:
    noise = np.random.default_rng(5).normal(0.0, 0.2, 2 * TURNS.size)
    masses = np.repeat([60.0, 75.0], TURNS.size)
    of_record = np.repeat(np.eye(2), TURNS.size, axis=0)
    acceleration = np.tile(ACCELERATION, 2)
    true_1 = np.concatenate([PLACE_1, PLACE_1 + off_1])
    force = masses * acceleration + force_at(true_1) + noise
    straight = np.column_stack([acceleration[:, None] * of_record, np.ones(force.size)])
    found = estimate_record_position_offsets(straight, force, np.tile(PLACE_1, 2), of_record)
    assert found == pytest.approx([0.0, off_1], abs=2e-3)


def test_the_slopes_are_those_of_the_forces() -> None:
    place_1, step = np.linspace(-0.5, 0.5, 31), 1e-6
    by_difference = (
        (make_position_force_columns(place_1 + step) - make_position_force_columns(place_1 - step))
        / step
        / 2
    )
    assert make_position_force_slopes(place_1) == pytest.approx(by_difference, abs=1e-6)
