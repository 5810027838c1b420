"""Hills that are hauled over in one direction and come back over in the other are no squat."""

import numpy as np
import pytest

from analysis.model.settings import Settings
from analysis.weighing.body_squat import LoadSquat, estimate_load_squat
from analysis.weighing.fit_columns import RelativeLoads
from analysis.weighing.haul_route import HaulRoute
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.wheel_comparison import compare_wheels_with_accelerometer
from tests.analysis.weighing.test_noisy_speed import WhiteNoise
from tests.twins import mark_heavy_after

PRIORS = Settings.model_validate({}).priors
RATE_HZ = 100.0
HAUL_M = 25.0
#: Grade of the haul as gravity along it, and of the hills on it, in m/s²: 0.2° and 0.1°.
GRADE_M_S2, HILLS_M_S2 = -0.035, 0.02
HILLS_LENGTH_M = 45.0
#: Masses of the empty machine and of one with its load.
EMPTY_KG, LOADED_KG = 3800.0, 4200.0


def gravity_m_s2(from_pile_m: Floats, facing: float, hills: float) -> Floats:
    """What the accelerometer sees of gravity, facing away from the pile or towards it."""
    wave = np.sin(2.0 * np.pi * from_pile_m / HILLS_LENGTH_M + 0.7)
    return facing * (GRADE_M_S2 + hills * wave)


def hauls(
    squat_1: float, hills: float, seed: int, cycles: int = 30
) -> tuple[MotionSamples, HaulRoute]:
    """A machine that turns at both ends and drives forwards; a load's squat is `squat_1` more."""
    dice = np.random.default_rng(seed)
    parts: list[tuple[Floats, Floats, Floats]] = []
    for leg in range(2 * cycles):
        loaded = leg % 2 == 0
        top_m_s, start_m_s2 = dice.uniform(1.8, 3.0), dice.uniform(0.7, 1.4)
        t_s = np.arange(round((HAUL_M / top_m_s + top_m_s / start_m_s2) * RATE_HZ)) / RATE_HZ
        v = top_m_s * (1.0 - np.exp(-start_m_s2 / top_m_s * t_s))
        driven_m = np.cumsum(v) / RATE_HZ
        v = v[driven_m < HAUL_M]
        driven_m = driven_m[driven_m < HAUL_M]
        a = np.gradient(v) * RATE_HZ
        place_m, facing = (driven_m, 1.0) if loaded else (HAUL_M - driven_m, -1.0)
        squat = squat_1 * a if loaded else 0.0
        parts.append((v, a + gravity_m_s2(place_m, facing, hills) + squat, a))
    v, measured, a = (np.concatenate(each) for each in zip(*parts, strict=True))
    number = np.repeat(np.arange(2 * cycles), [each[0].size for each in parts])
    measured = measured + dice.normal(0.0, 0.01, a.size)
    speed = v + dice.normal(0.0, 0.004, v.size)
    force = 4000.0 * a + 900.0 * v + dice.normal(0.0, 60.0, a.size)
    motion = MotionSamples(
        measured, speed, force, number, np.ones(a.size), number, RATE_HZ, measured, None, None,
        np.linspace(-0.5, 0.5, a.size), np.cumsum(v) / RATE_HZ, np.zeros(a.size), 0.0, True, 1.0,
        4000.0 * 9.81,
    )  # fmt: skip
    numbers = np.arange(2 * cycles)
    route = HaulRoute.from_motion(motion, numbers, numbers % 2 == 0)
    assert route is not None
    return motion, route


def squat_of(motion: MotionSamples, route: HaulRoute | None) -> LoadSquat:
    unit = np.unique(motion.manoeuvre_of_sample)
    loads = RelativeLoads.from_masses(
        unit, np.where(unit % 2 == 0, LOADED_KG, EMPTY_KG), (0.5, 0.5)
    )
    wheels = compare_wheels_with_accelerometer(motion, WhiteNoise(0.004), PRIORS)
    assert loads is not None
    assert wheels is not None
    relative = np.array([-0.05, 0.05])
    squat = estimate_load_squat(motion, wheels, loads, relative, PRIORS.gain_by_load, route)
    assert squat is not None
    return squat


@pytest.mark.parametrize("hills", [-HILLS_M_S2, HILLS_M_S2])
@pytest.mark.parametrize("seed", range(3))
def test_a_stiff_body_is_found_to_be_stiff_on_hills(seed: int, hills: float) -> None:
    squat = squat_of(*hauls(0.0, hills, seed))
    assert squat.gain == 0.0


@pytest.mark.parametrize("hills", [-HILLS_M_S2, -0.01, 0.0, HILLS_M_S2])
@pytest.mark.parametrize("seed", mark_heavy_after(1, range(3)))
def test_a_squat_is_found_on_hills(seed: int, hills: float) -> None:
    """A tenth more mass makes the body pitch by three percent of the acceleration more."""
    squat = squat_of(*hauls(0.03, hills, seed))
    assert squat.gain == pytest.approx(-0.3, abs=3.0 * squat.std)
    assert squat.std < 0.02


def test_without_the_route_hills_of_a_twentieth_of_a_degree_change_it_by_half() -> None:
    motion, _ = hauls(0.03, -0.01, seed=1)
    assert squat_of(motion, None).gain < -0.45


def test_the_machine_faces_the_dump_on_its_haul_and_turns_its_back_on_the_way_back() -> None:
    motion, route = hauls(0.0, 0.0, seed=1, cycles=4)
    place, heading = (
        route.compute_relative_distances_to_dump(motion),
        route.compute_headings_from_dump(motion),
    )
    between = (place > 0.01) & (place < 0.7)
    faces = np.where(motion.manoeuvre_of_sample % 2 == 0, -1.0, 1.0)
    np.testing.assert_array_equal(heading[between], faces[between])
