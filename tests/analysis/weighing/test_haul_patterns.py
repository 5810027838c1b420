"""Loads as the way of driving suggests them: a machine that hauls stands at the same places."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.weighing.haul_route import propose_hauling_partitions
from analysis.weighing.load_changes import find_manoeuvre_of_stretches
from analysis.weighing.motion_samples import MotionSamples

RATE_HZ = 10.0
SPEED_M_S = 2.0
#: One haul of a machine that is loaded on its way and backs out from where it dumps, in m: there
#: empty, on with the load, with a stop, and back.
HAUL_M = (55.0, 33.0, 28.0, -6.0)
LOADED = (False, True, True, False)


def drives(legs_m: list[float], moved_boom_after: tuple[int, ...] = ()) -> MotionSamples:
    """A machine that drives these legs, forwards or in reverse, and stands between them."""
    lengths = [round(abs(leg_m) / SPEED_M_S * RATE_HZ) for leg_m in legs_m]
    number = np.arange(len(legs_m)).repeat(lengths)
    direction = np.sign(legs_m).repeat(lengths)
    # each leg gains its speed
    speed = direction * np.concatenate([np.linspace(0.1, SPEED_M_S, n) for n in lengths])
    driven_m = np.cumsum(np.full(number.size, SPEED_M_S / RATE_HZ))
    zeros = np.zeros(number.size)
    boom = sum((number > leg).astype(np.float64) for leg in moved_boom_after)
    return MotionSamples(
        zeros, speed, zeros, number, direction, number, RATE_HZ, None, None, None,
        zeros, driven_m, zeros, 0.0, True, 1.0, 40_000.0,
        boom_and_bucket_angles_rad=(boom,) if moved_boom_after else (),
    )  # fmt: skip


def loads_of(loaded: list[bool]) -> list[int]:
    """Numbers of the loads, from 0 on in time."""
    return np.append(0, np.cumsum(np.diff(loaded) != 0)).tolist()


def suggested(motion: MotionSamples) -> list[list[int]]:
    return [each.tolist() for each in propose_hauling_partitions(motion)]


def test_loads_change_at_two_places_of_a_haul():
    assert loads_of(list(LOADED) * 8) in suggested(drives(list(HAUL_M) * 8))


def test_hauls_without_the_stop_have_the_same_places():
    legs, loaded = list(HAUL_M) * 8, list(LOADED) * 8
    # the third haul goes through
    legs[9:11], loaded[9:11] = [61.0], [True]
    assert loads_of(loaded) in suggested(drives(legs))


def test_a_place_from_which_no_manoeuvre_is_left_is_where_others_have_theirs():
    """It backed out of the pile, dug and dumped, eight times; once none of it was its own start."""
    legs = [60.0, -7.0, 60.0, -7.0] * 8
    loaded = [False, True, True, False] * 8
    legs[16:18], loaded[16:18] = [67.0], [False]
    assert loads_of(loaded) in suggested(drives(legs))


def test_loads_that_go_by_the_direction_are_suggested_only_where_something_tells_of_them():
    legs, loaded = [24.0, -24.0] * 8, [False, True] * 8
    assert loads_of(loaded) not in suggested(drives(legs))
    boom_moves = tuple(range(0, 16, 2))
    assert loads_of(loaded) in suggested(drives(legs, boom_moves))


@pytest.mark.parametrize("legs", [[40.0] * 12, [40.0, -40.0], [10.0, -35.0, 80.0, -3.0, 22.0]])
def test_driving_that_does_not_come_back_suggests_nothing(legs: list[float]):
    assert suggested(drives(legs)) == []


def test_a_manoeuvre_that_only_cruises_is_none_of_its_own():
    """A record that begins while the machine cruises tells no mass: any would do."""
    motion = drives([20.0, 20.0, 20.0, 20.0])
    cruises = motion.manoeuvre_of_sample == 2
    motion = replace(motion, speed=np.where(cruises, SPEED_M_S, motion.speed))
    assert find_manoeuvre_of_stretches(motion).tolist() == [0, 1, 1, 3]
