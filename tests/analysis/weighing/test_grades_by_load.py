"""Grades that come back with the load, seen without a pitch channel, are no body that squats."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.model.settings import Settings
from analysis.weighing.body_squat import LoadSquat, estimate_load_squat
from analysis.weighing.fit_columns import RelativeLoads
from analysis.weighing.wheel_comparison import compare_wheels_with_accelerometer
from tests.analysis.weighing.test_noisy_speed import WhiteNoise
from tests.analysis.weighing.test_pitch_squat import starts

PRIORS = Settings.model_validate({}).priors


def squat_of(hills_m_s2: float, heavy_place: int, seed: int) -> LoadSquat:
    """Of starts at two places in turn, loaded at one of them, of a body that is stiff."""
    _, motion = starts(0.0, hills_m_s2, seed)
    blind = replace(motion, without_gravity=None)
    unit = np.unique(motion.manoeuvre_of_sample)
    loads = RelativeLoads.from_masses(
        unit, np.where(unit % 2 == heavy_place, 4200.0, 3800.0), (0.5, 0.5)
    )
    wheels = compare_wheels_with_accelerometer(blind, WhiteNoise(0.004), PRIORS)
    assert loads is not None
    assert wheels is not None
    squat = estimate_load_squat(blind, wheels, loads, np.array([-0.05, 0.05]), PRIORS.gain_by_load)
    assert squat is not None
    return squat


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("heavy_place", [0, 1])
@pytest.mark.parametrize("hills_m_s2", [0.05, 0.15])
def test_hills_are_no_squat_at_whichever_place_the_load_is(
    hills_m_s2: float, heavy_place: int, seed: int
) -> None:
    squat = squat_of(hills_m_s2, heavy_place, seed)
    assert squat.gain == 0.0
    # nor is a squat ruled out that they hide
    assert squat.std > 0.015


def test_level_ground_rules_a_squat_out() -> None:
    assert squat_of(0.0, 0, seed=3).std < 0.002


@pytest.mark.parametrize("seed", range(6))
def test_grades_that_wheels_and_accelerometer_still_disagree_by_are_no_squat(seed: int) -> None:
    """Grades that change alike at every start read as a few percent of the acceleration."""
    _, motion = starts(0.0, -0.02, seed)
    blind = replace(motion, without_gravity=None, wheel_radius_u_1=0.005)
    wheels = compare_wheels_with_accelerometer(blind, WhiteNoise(0.004), PRIORS)
    assert wheels is not None
    assert not wheels.is_consistent
    assert wheels.squat == (0.0, 0.0)
