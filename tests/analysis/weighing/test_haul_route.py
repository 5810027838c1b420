"""The route: a haul and the way back are over the same ground, counted from the dump."""

import numpy as np
import pytest

from analysis.weighing.haul_route import Route
from analysis.weighing.motion_samples import MotionSamples

HAUL_M = 40.0
RATE_HZ = 10.0


def shuttle(cycles: int, first_loaded: bool = True) -> tuple[MotionSamples, np.ndarray, np.ndarray]:
    """A machine that hauls 40 m and comes back in reverse, its manoeuvres, and which haul."""
    legs = 2 * cycles
    speed_m_s = np.tile([2.0, -2.0], cycles).repeat(round(HAUL_M / 2.0 * RATE_HZ))
    number = np.arange(legs).repeat(round(HAUL_M / 2.0 * RATE_HZ))
    zeros = np.zeros(speed_m_s.size)
    motion = MotionSamples(
        zeros, speed_m_s, zeros, number, np.sign(speed_m_s), number, RATE_HZ, None, None, None,
        zeros, np.cumsum(np.abs(speed_m_s)) / RATE_HZ, zeros, 0.0, True, 1.0, 40_000.0,
    )  # fmt: skip
    return motion, np.arange(legs), (np.arange(legs) % 2 == 0) == first_loaded


def test_the_same_place_is_at_the_same_position_on_the_way_and_back():
    motion, unit, loaded = shuttle(4)
    route = Route.of(motion, unit, loaded)
    assert route is not None
    assert route.haul_m == pytest.approx(HAUL_M)
    position = route.position(motion, loaded[motion.unit])
    place_m = np.cumsum(motion.speed) / RATE_HZ
    np.testing.assert_allclose(position, 1.0 - place_m / HAUL_M, atol=0.01)


def test_pieces_of_a_log_have_the_positions_of_the_whole():
    motion, unit, loaded = shuttle(6)
    route = Route.of(motion, unit, loaded)
    assert route is not None
    whole = route.position(motion, loaded[motion.unit])
    part = motion.first_stretches(5)
    np.testing.assert_array_equal(route.position(part, loaded[part.unit]), whole[: part.unit.size])


def test_before_the_first_dump_and_behind_the_last_the_machine_is_far_from_any():
    motion, unit, loaded = shuttle(3, first_loaded=False)
    route = Route.of(motion, unit, loaded)
    assert route is not None
    position = route.position(motion, loaded[motion.unit])
    assert (position[motion.unit == 0] == 1.0).all()
    # the last haul has no dump behind it
    assert (position[motion.unit == 5] == 1.0).all()


def test_loads_that_are_never_dumped_have_no_route():
    motion, unit, _ = shuttle(3)
    assert Route.of(motion, unit, np.zeros(unit.size, np.bool_)) is None
