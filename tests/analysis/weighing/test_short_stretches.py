"""A manoeuvre too short to tell a mass goes with the one whose load it carries."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.weighing.load_changes import (
    classify_load_change_evidence,
    find_manoeuvre_of_stretches,
)
from analysis.weighing.motion_samples import MotionSamples
from estimators.joint.unit_levels import DUMPED, FILLED, HINTED, TURNED

#: Samples of a manoeuvre, of one too short to tell a mass, and of the stand between.
LONG, SHORT, STAND = 200, 20, 100


def manoeuvres(
    boom: list[float], digs: list[bool], *, backs_out_with: float = 0.0
) -> MotionSamples:
    """A long manoeuvre, a short one and a long one, with stands between them.

    Args:
        boom: how far the boom is out in each of the two stands, in rad.
        digs: whether the machine digs in each.
        backs_out_with: how far the boom is out in most of the first manoeuvre.
    """
    sizes = [LONG, STAND, SHORT, STAND, LONG]
    part = np.repeat(np.arange(5), sizes)
    n = part.size
    moving = part % 2 == 0
    arm, dug = np.zeros(n), np.zeros(n, np.bool_)
    for stand in (0, 1):
        here = np.flatnonzero(part == 1 + 2 * stand)
        arm[here[30:60]] = boom[stand]
        dug[here] = digs[stand]
    arm[LONG // 3 : LONG] = backs_out_with
    ones = np.ones(n)
    return MotionSamples(
        acceleration=ones,
        speed=ones,
        force=ones,
        stretch_of_sample=np.where(moving, part // 2, -1),
        direction=ones,
        manoeuvre_of_sample=part // 2,
        rate_hz=100.0,
        specific_force=None,
        without_gravity=None,
        wheel_acceleration=None,
        progress=np.arange(n) / n - 0.5,
        driven_m=np.zeros(n),
        path_position_1=np.zeros(n),
        path_m=0.0,
        by_accelerometer=False,
        force_share=1.0,
        empty_weight_N=35_000.0,
        boom_and_bucket_angles_rad=(arm,),
        is_digging=dug,
    )


@pytest.mark.parametrize(
    ("boom", "with_number"),
    [([0.0, 0.0], 0), ([0.8, 0.0], 2), ([0.0, 0.8], 0), ([0.8, 0.8], 0)],
)
def test_it_goes_with_the_one_behind_where_the_boom_dumps_before_it(
    boom: list[float], with_number: int
) -> None:
    units = find_manoeuvre_of_stretches(manoeuvres(boom, [False, False]))
    assert units.tolist() == [0, with_number, 2]


def test_digging_between_manoeuvres_is_a_filling_a_boom_a_dump_and_its_return_a_hint() -> None:
    assert classify_load_change_evidence(manoeuvres([0.8, 0.8], [False, True])).tolist() == [FILLED]
    dumped = manoeuvres([0.8, 0.0], [False, False])
    assert classify_load_change_evidence(dumped).tolist() == [DUMPED]
    returned = manoeuvres([0.0, 0.0], [False, False], backs_out_with=0.8)
    assert classify_load_change_evidence(returned).tolist() == [HINTED]
    assert classify_load_change_evidence(manoeuvres([0.0, 0.0], [False, False])).tolist() == [1]


@pytest.mark.parametrize(
    ("directions", "boom_rad", "kind"),
    [
        # the short manoeuvre goes with the first: what counts is how the machine arrives and leaves
        ((1.0, 1.0, -1.0), 0.0, TURNED),
        ((-1.0, 1.0, -1.0), 0.0, TURNED),
        ((1.0, -1.0, -1.0), 0.0, 1),
        ((-1.0, -1.0, 1.0), 0.0, 1),
        # a boom tells better
        ((1.0, 1.0, -1.0), 0.8, DUMPED),
    ],
)
def test_backing_out_of_where_it_arrived_is_a_hint_where_no_boom_is(
    directions: tuple[float, float, float], boom_rad: float, kind: int
) -> None:
    motion = manoeuvres([0.0, boom_rad], [False, False])
    motion = replace(motion, direction=np.array(directions)[motion.manoeuvre_of_sample])
    assert classify_load_change_evidence(motion).tolist() == [kind]
