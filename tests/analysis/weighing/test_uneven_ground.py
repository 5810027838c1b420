"""Ground along the way: terms that are the same at every start with a load, or without one."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import MotionSamples
from analysis.weighing.uneven_ground import GRADE, GROUND, does_load_search_include_ground

SAMPLES = 200
PLACES_M = np.linspace(0.0, 80.0, SAMPLES)


def moments(direction: float = 1.0, contrast: float = 1.0) -> ColumnInputs:
    """A stretch of 80 m, one way, of a machine with a load or without."""
    zeros = np.zeros(SAMPLES)
    return ColumnInputs(
        *(zeros,) * 8,
        np.full(SAMPLES, direction),
        zeros,
        zeros,
        zeros,
        np.full(SAMPLES, contrast),
        zeros,
        PLACES_M,
        np.linspace(1.0, 0.0, SAMPLES),
        40.0,
        zeros,
        *(0.0,) * 3,
        (0.0, 0.0),
        None,
    )


def motion(manoeuvres: int, reverse: bool = True) -> MotionSamples:
    """A sample a manoeuvre, every other one in reverse."""
    zeros, number = np.zeros(manoeuvres), np.arange(manoeuvres)
    direction = np.where((number % 2 == 1) & reverse, -1.0, 1.0)
    return MotionSamples(
        zeros, zeros, zeros, number, direction, number, 100.0, None, None, None, zeros, zeros,
        zeros, 0.0, True, 1.0, 40_000.0,
    )  # fmt: skip


def force(m: ColumnInputs, *names: str) -> np.ndarray:
    """Of terms whose parameters are 1 N."""
    return np.sum([term.column(m) for term in GROUND if term.name in names], axis=0)


def test_the_changes_along_the_way_are_lines_between_places():
    changes = [term.name for term in GROUND if term.name.endswith("m") and "forward" in term.name]
    whole = force(moments(), *changes)
    assert whole[0] == 0.0
    assert whole[-1] == pytest.approx(len(changes))
    assert (np.diff(whole) >= 0.0).all()
    # 4 m into a way: one whole line of 2 m, and half of the next
    assert np.interp(4.0, PLACES_M, whole) == pytest.approx(1.5, abs=0.05)


def test_a_machine_in_reverse_feels_the_ground_of_its_own_way_the_other_way_round():
    forward, reverse = "ground_forward_0_2m", "ground_reverse_0_2m"
    assert not force(moments(direction=-1.0), forward).any()
    backward = force(moments(direction=-1.0), reverse)
    np.testing.assert_allclose(backward, -force(moments(), forward))


def test_loaded_starts_and_empty_ones_are_on_ground_of_their_own():
    names = "ground_forward_by_load", "ground_forward_2_6m_by_load"
    loaded, empty = (force(moments(contrast=each), *names) for each in (1.0, -1.0))
    np.testing.assert_allclose(loaded, -empty)
    assert loaded.any()


def test_the_loads_of_few_manoeuvres_are_searched_without_the_ground():
    least = LIMITS.ground_min_manoeuvres
    assert not does_load_search_include_ground(motion(least - 1))
    assert does_load_search_include_ground(motion(least))


def test_two_manoeuvres_have_ground_and_those_one_way_none_of_the_other():
    one_way = [term.name for term in GROUND if term.applies(motion(2, reverse=False))]
    both_ways = [term.name for term in GROUND if term.applies(motion(2))]
    assert [name for name in both_ways if "reverse" not in name] == one_way
    assert sum("forward" in name for name in one_way) == len(both_ways) - len(one_way) > 0


def test_every_term_needs_load_states_and_is_wider_over_a_longer_way():
    assert all(term.by_load for term in GROUND)
    widths = {term.name: term.compute_prior_std(motion(24), PriorSettings()) for term in GROUND}
    assert widths["ground_forward_0_2m"] < widths["ground_forward_2_6m"]
    # half a percent of the weight over ten metres
    assert widths["ground_forward_2_6m"] == pytest.approx(0.005 * 40_000.0 * np.sqrt(0.4))


def test_the_route_has_an_edge_wherever_it_is_for_all_loads_and_in_proportion_to_them():
    parts = [term for term in GROUND if "route" in term.name]
    whole = np.sum([term.column(moments()) for term in parts], axis=0)
    # 40 m in lines of 2 m, counted from the dump, whose width is that of a change over 10 m
    assert whole[-1] == 0.0
    assert whole[0] == pytest.approx(len(parts) * np.sqrt(40.0 / len(parts) / 10.0))
    heavier = replace(moments(), relative_load=np.full(SAMPLES, 0.3))
    np.testing.assert_allclose(
        np.sum([term.column(heavier) for term in parts], axis=0), 1.3 * whole
    )


def grade(m: ColumnInputs) -> np.ndarray:
    """Of the grade's terms whose parameters are 1 N."""
    return np.sum([term.column(m) for term in GRADE], axis=0)


def test_a_grade_has_the_other_sign_on_the_way_back_and_is_in_proportion_to_the_weight():
    away = np.ones(SAMPLES)
    there, back = (replace(moments(), heading_from_dump=sign * away) for sign in (-1.0, 1.0))
    np.testing.assert_allclose(grade(there), -grade(back))
    heavier = replace(back, relative_load=np.full(SAMPLES, 0.3))
    np.testing.assert_allclose(grade(heavier), 1.3 * grade(back))
    # at the dump 1 N, and 40 m farther all its changes
    assert grade(back)[-1] == pytest.approx(1.0)
    assert grade(back)[0] == pytest.approx(1.0 + len(GRADE[1:]) * np.sqrt(40.0 / 24.0 / 10.0))


def test_there_is_no_grade_without_a_route_or_where_gravity_is_measured_or_nothing_reverses():
    assert not grade(moments()).any()
    assert all(term.applies(motion(2)) for term in GRADE)
    assert not any(term.applies(motion(2, reverse=False)) for term in GRADE)
    measured = replace(motion(2), has_measured_gravity=True)
    assert not any(term.applies(measured) for term in GRADE)
