"""The route: a haul and the way back are over the same ground, counted from the dump."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.weighing.haul_route import HaulRoute
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
    route = HaulRoute.from_motion(motion, unit, loaded)
    assert route is not None
    assert route.length_m == pytest.approx(1.2 * HAUL_M)
    position = route.compute_relative_distances_to_dump(motion)
    place_m = np.cumsum(motion.speed) / RATE_HZ
    np.testing.assert_allclose(position, (HAUL_M - place_m) / route.length_m, atol=0.01)


def test_pieces_of_a_log_have_the_positions_of_the_whole():
    motion, unit, loaded = shuttle(6)
    route = HaulRoute.from_motion(motion, unit, loaded)
    assert route is not None
    whole = route.compute_relative_distances_to_dump(motion)
    part = motion.cut_to_first_stretches(5)
    np.testing.assert_array_equal(
        route.compute_relative_distances_to_dump(part), whole[: part.manoeuvre_of_sample.size]
    )


def test_farther_from_any_dump_than_a_haul_the_machine_is_at_the_end_of_the_route():
    motion, unit, loaded = shuttle(3, first_loaded=False)
    route = HaulRoute.from_motion(motion, unit, loaded)
    assert route is not None
    position = route.compute_relative_distances_to_dump(motion)
    # two hauls before the first dump; the last haul has no dump behind it
    assert (position[motion.driven_m < route.dump_positions_m[0] - route.length_m] == 1.0).all()
    assert (position[motion.driven_m > route.dump_positions_m[-1] + route.length_m] == 1.0).all()


def test_a_load_that_is_taken_for_none_is_where_the_others_are():
    motion, unit, loaded = shuttle(6)
    missed = loaded & (unit != 4)
    route, whole = (
        HaulRoute.from_motion(motion, unit, missed),
        HaulRoute.from_motion(motion, unit, loaded),
    )
    assert route is not None
    assert whole is not None
    np.testing.assert_array_equal(route.dump_positions_m, whole.dump_positions_m)


def test_a_long_way_that_is_no_number_of_cycles_has_no_dump():
    motion, unit, loaded = shuttle(6)
    longer = motion.driven_m + 0.5 * HAUL_M * (motion.manoeuvre_of_sample > 5)
    motion = replace(motion, driven_m=longer)
    route = HaulRoute.from_motion(motion, unit, loaded & (unit != 4))
    assert route is not None
    assert route.dump_positions_m.size == 5


def test_loads_that_are_never_dumped_have_no_route():
    motion, unit, _ = shuttle(3)
    assert HaulRoute.from_motion(motion, unit, np.zeros(unit.size, np.bool_)) is None
